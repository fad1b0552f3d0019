"""The curves of a guidance run: velocities as in the paper's last two figures, and errors."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from robust6dof.simulation.trace import Trace

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_COMMANDED, _ACHIEVED = "#d62728", "#111111"
_TRUE, _ESTIMATED, _LIMIT = "#2ca02c", "#e69f00", "#777777"
_AXIS_COLORS = ("#d62728", "#2ca02c", "#1f77b4")


def plot_velocities(trace: Trace, path: Path) -> None:
    """Commanded (red) and achieved (black) velocities of vehicle and arm."""
    figure, axes = _grid(4, 2, (11.0, 9.0))
    time = trace.column("time_s")
    vehicle = [
        ("vx", "$v_x$ [m/s]", "m_s"),
        ("vy", "$v_y$ [m/s]", "m_s"),
        ("vz", "$v_z$ [m/s]", "m_s"),
        ("wz", r"$\omega_z$ [rad/s]", "rad_s"),
    ]
    for row, (name, label, unit) in enumerate(vehicle):
        signals = (f"{name}_cmd_{unit}", f"{name}_{unit}")
        _pair(axes[row][0], time, trace, signals, label)
    for row in range(4):
        signals = (f"joint{row + 1}_rate_cmd_rad_s", f"joint{row + 1}_rate_rad_s")
        _pair(axes[row][1], time, trace, signals, rf"$\dot\eta_{row + 1}$ [rad/s]")
    axes[0][0].set_title("vehicle, body axes")
    axes[0][1].set_title("arm joints")
    axes[0][0].legend(loc="upper right", fontsize=9)
    _finish(figure, axes, path)


def plot_errors(trace: Trace, path: Path, delta_R: float, delta_T: float) -> None:
    """Distance from the goal in truth and as estimated, its parts, and the vehicle's tilt.

    Args:
        trace: of the run.
        path: the PNG.
        delta_R: rotation threshold [rad].
        delta_T: translation threshold [m].
    """
    figure, axes = _grid(3, 2, (11.0, 8.0))
    time = trace.column("time_s")
    sides = (
        ("translation", "m", delta_T, r"$\|T-T^*\|$ [m]"),
        ("rotation", "rad", delta_R, r"$\theta$ [rad]"),
    )
    for side, (name, unit, threshold, label) in enumerate(sides):
        _norms(axes[0][side], time, trace, (name, unit), threshold, label)
        for axis, color in zip("xyz", _AXIS_COLORS, strict=True):
            signal = trace.column(f"true_{name}_error_{axis}_{unit}")
            axes[1][side].plot(time, signal, color=color, label=axis, linewidth=1.2)
        axes[1][side].set_ylabel(f"{name}, camera axes [{unit}]")
        axes[1][side].legend(loc="upper right", fontsize=9, ncols=3)
    for signal, color in (("roll", _AXIS_COLORS[0]), ("pitch", _AXIS_COLORS[1])):
        degrees = np.degrees(trace.column(f"{signal}_rad"))
        axes[2][0].plot(time, degrees, color=color, label=signal, linewidth=1.2)
    axes[2][0].set_ylabel("tilt from the dynamics [deg]")
    axes[2][0].legend(loc="upper right", fontsize=9, ncols=2)
    _tracking(axes[2][1], time, trace)
    axes[0][0].set_title("translation")
    axes[0][1].set_title("rotation")
    _finish(figure, axes, path)


def _grid(rows: int, columns: int, size: tuple[float, float]) -> tuple[Figure, list[list[Axes]]]:
    # Not through pyplot: no display, no global state, safe in worker processes.
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, layout="constrained")
    FigureCanvasAgg(figure)
    return figure, figure.subplots(rows, columns, sharex=True, squeeze=False).tolist()


def _finish(figure: Figure, axes: list[list[Axes]], path: Path) -> None:
    for axis in (axis for row in axes for axis in row):
        axis.grid(alpha=0.3)
    for axis in axes[-1]:
        axis.set_xlabel("time [s]")
    figure.savefig(path, dpi=110)


def _pair(axis: Axes, time: np.ndarray, trace: Trace, signals: tuple[str, str], label: str) -> None:
    commanded, achieved = (trace.column(name) for name in signals)
    axis.plot(time, achieved, color=_ACHIEVED, linewidth=1.0, label="achieved")
    axis.plot(time, commanded, color=_COMMANDED, linewidth=1.4, label="commanded")
    axis.set_ylabel(label)
    # A signal that is nearly zero shall not fill the panel with its noise.
    reach = max(0.05, float(np.abs(np.concatenate([commanded, achieved])).max()) * 1.1)
    axis.set_ylim(-reach, reach)


def _norms(
    axis: Axes,
    time: np.ndarray,
    trace: Trace,
    names: tuple[str, str],
    threshold: float,
    label: str,
) -> None:
    from matplotlib.ticker import LogLocator, NullFormatter

    name, unit = names
    estimated = trace.column(f"estimated_{name}_error_{unit}")
    axis.plot(time, estimated, color=_ESTIMATED, linewidth=1.2, label="estimated")
    true = trace.column(f"true_{name}_error_{unit}")
    axis.plot(time, true, color=_TRUE, linewidth=1.4, label="true")
    axis.axhline(threshold, color=_LIMIT, linestyle="--", linewidth=1.0, label="threshold")
    axis.set_yscale("log")
    axis.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.yaxis.set_major_formatter("{x:g}")
    axis.yaxis.set_minor_formatter(NullFormatter())
    axis.set_ylabel(label)
    axis.legend(loc="upper right", fontsize=9)


def _tracking(axis: Axes, time: np.ndarray, trace: Trace) -> None:
    """The pose source's own error: degrees on the left, centimetres on the right."""
    right = axis.twinx()
    degrees = np.degrees(trace.column("tracking_error_rad"))
    centimetres = 100.0 * trace.column("tracking_error_m")
    axis.plot(time, degrees, color="#9467bd", linewidth=1.2)
    right.plot(time, centimetres, color="#17becf", linewidth=1.2)
    axis.set_ylabel("pose error [deg]", color="#9467bd")
    right.set_ylabel("pose error [cm]", color="#17becf")
    for side, signal in ((axis, degrees), (right, centimetres)):
        side.set_ylim(0.0, 1.1 * max(1.0, float(np.nanmax(signal, initial=0.0))))
