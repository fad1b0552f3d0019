"""The experiments' plots: curves with intervals, bars, and scatter, one look for all."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from robust6dof.evaluation.calibration import Reliability
from robust6dof.evaluation.intervals import Interval
from robust6dof.evaluation.scores import Scores


@dataclass(frozen=True)
class Series:
    """A curve: value and interval at each place."""

    values: Sequence[float]
    intervals: Sequence[tuple[float, float] | None] = field(default=())
    dashed: bool = False
    """On the right axis, where there is one."""


def series_of(rows: Sequence[Scores], key: str) -> Series:
    """One metric of several scores, with its intervals."""
    intervals = [scores.details.get("interval95", {}).get(key) for scores in rows]
    return Series([scores.mean[key] for scores in rows], intervals)


def plot_curves(
    path: Path,
    x: Sequence[float],
    series: Mapping[str, Series],
    xlabel: str,
    ylabel: str,
    right_label: str = "",
    log_scale: bool = False,
) -> Path:
    """One line for each series with its interval as a band; dashed ones on the right axis.

    The left axis holds per cent, or anything positive on a logarithmic scale.
    """
    figure = Figure(figsize=(6.4, 4.0), layout="constrained")
    left: Axes = figure.subplots()
    right = left.twinx() if right_label else left
    for index, (name, one) in enumerate(series.items()):
        axes, color = (right if one.dashed else left), f"C{index}"
        style = "--" if one.dashed else "-"
        axes.plot(x, one.values, style, marker="o", markersize=4, color=color, label=name)
        if len(one.intervals) == len(x) and all(ends is not None for ends in one.intervals):
            low, high = zip(*(ends for ends in one.intervals if ends is not None), strict=True)
            axes.fill_between(x, low, high, color=color, alpha=0.15, linewidth=0)
    left.set(xlabel=xlabel, ylabel=ylabel)
    left.set(yscale="log") if log_scale else left.set(ylim=(0, 102))
    if right_label:
        right.set_ylabel(right_label)
        right.set_ylim(bottom=0)
    left.grid(alpha=0.3)
    figure.legend(loc="outside upper center", ncols=4, fontsize="small")
    return _save(figure, path)


def plot_reliability(path: Path, found: Mapping[str, Reliability]) -> Path:
    """Share of right poses against claimed confidence, beside the diagonal of honesty."""
    figure = Figure(figsize=(4.8, 4.8), layout="constrained")
    axes: Axes = figure.subplots()
    axes.plot([0, 100], [0, 100], "--", color="gray", linewidth=1)
    for name, one in found.items():
        label = f"{name} (ECE {100 * one.expected_error:.1f})"
        axes.plot(100 * one.confidence, 100 * one.share, "-o", markersize=4, label=label)
    axes.set(xlabel="confidence [%]", ylabel="poses within 10° 5 cm [%]")
    axes.set(xlim=(0, 102), ylim=(0, 102))
    axes.grid(alpha=0.3)
    figure.legend(loc="outside upper center", ncols=2, fontsize="small")
    return _save(figure, path)


def plot_bars(
    path: Path,
    groups: Sequence[str],
    series: Mapping[str, Series],
    ylabel: str,
) -> Path:
    """Bars of every series side by side in each group, with intervals."""
    figure = Figure(figsize=(6.4, 4.0), layout="constrained")
    axes: Axes = figure.subplots()
    width = 0.8 / max(len(series), 1)
    for index, (name, one) in enumerate(series.items()):
        places = [group + (index + 0.5) * width - 0.4 for group in range(len(groups))]
        axes.bar(places, one.values, width, label=name)
        for place, value, ends in zip(places, one.values, one.intervals, strict=False):
            if ends is not None:
                error = [[max(value - ends[0], 0.0)], [max(ends[1] - value, 0.0)]]
                axes.errorbar(place, value, yerr=error, color="black", capsize=3, linewidth=1)
    axes.set_xticks(range(len(groups)), groups)
    axes.set(ylabel=ylabel, ylim=(0, 102))
    axes.grid(axis="y", alpha=0.3)
    figure.legend(loc="outside upper center", ncols=4, fontsize="small")
    return _save(figure, path)


def plot_scatter(
    path: Path,
    points: Mapping[str, tuple[float, float]],
    intervals: Mapping[str, Interval],
    key: str,
    xlabel: str,
    ylabel: str,
) -> Path:
    """One named point for each tracker, both axes from zero."""
    figure = Figure(figsize=(6.4, 4.0), layout="constrained")
    axes: Axes = figure.subplots()
    for index, (name, (x, y)) in enumerate(points.items()):
        ends = intervals.get(name, {}).get(key)
        error = None if ends is None else [[max(y - ends[0], 0.0)], [max(ends[1] - y, 0.0)]]
        axes.errorbar(x, y, yerr=error, fmt="o", capsize=3, color=f"C{index}", label=name)
    if points:
        figure.legend(loc="outside upper center", ncols=4, fontsize="small")
    axes.set(xlabel=xlabel, ylabel=ylabel, ylim=(0, 104))
    axes.set_xlim(left=0.0)
    axes.grid(alpha=0.3)
    return _save(figure, path)


def _save(figure: Figure, path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=120)
    return path
