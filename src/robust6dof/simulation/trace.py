"""Every signal of a run at the servo's rate."""

from __future__ import annotations

import csv
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from robust6dof.servo.interaction import extended_image_point
from robust6dof.simulation.judge import GoalError
from robust6dof.simulation.plant import OnboardReading, VehicleCommand, VehicleState

Row = dict[str, float | str]
"""One tick; keys are the CSV's column names, units in them."""


@dataclass(frozen=True, eq=False)
class Trace:
    """Rows of a run, oldest first; all have the same keys."""

    rows: tuple[Row, ...]

    def __len__(self) -> int:
        return len(self.rows)

    def column(self, name: str) -> Float[np.ndarray, "T"]:
        """One numeric signal over time."""
        return np.array([float(row[name]) for row in self.rows])

    def columns(self, *names: str) -> Float[np.ndarray, "T C"]:
        """Several numeric signals over time."""
        return np.stack([self.column(name) for name in names], axis=1)

    def write(self, path: Path) -> None:
        """Write as CSV."""
        with path.open("w", newline="") as file:
            writer = csv.DictWriter(file, fieldnames=list(self.rows[0]), lineterminator="\n")
            writer.writeheader()
            for row in self.rows:
                writer.writerow({key: _text(value) for key, value in row.items()})

    @staticmethod
    def read(path: Path) -> Trace:
        """Read what `write` wrote; every value is text or a number again."""
        with path.open(newline="") as file:
            return Trace(tuple(dict(row) for row in csv.DictReader(file)))


def vehicle_signals(state: VehicleState, reading: OnboardReading, command: VehicleCommand) -> Row:
    """Commanded and achieved velocities, attitude, joints."""
    row: Row = {}
    _put(row, "vx_cmd_m_s vy_cmd_m_s vz_cmd_m_s", command.velocity_body)
    row["wz_cmd_rad_s"] = command.yaw_rate
    _put(row, "vx_m_s vy_m_s vz_m_s", state.velocity_body)
    row["wz_rad_s"] = state.rates_body[2]
    _put(row, [f"joint{i}_rate_cmd_rad_s" for i in range(1, 5)], command.joint_rates)
    _put(row, [f"joint{i}_rate_rad_s" for i in range(1, 5)], state.joint_rates)
    _put(row, [f"joint{i}_rad" for i in range(1, 5)], state.joints)
    _put(row, "roll_rad pitch_rad yaw_rad", state.roll_pitch_yaw)
    _put(row, "wx_rad_s wy_rad_s", state.rates_body[:2])
    _put(row, "wx_measured_rad_s wy_measured_rad_s", reading.tilt_rates)
    _put(row, "x_m y_m z_m", state.T_world_body[:3, 3])
    return row


def pose_signals(prefix: str, T_cam_obj: Float[np.ndarray, "4 4"] | None, error: GoalError) -> Row:
    """Where the object is in the camera, and how far that is from the goal."""
    place = np.full(3, np.nan) if T_cam_obj is None else T_cam_obj[:3, 3]
    point = np.full(3, np.nan)
    if T_cam_obj is not None and place[2] > 0:
        point = extended_image_point(place)
    row: Row = {}
    _put(row, [f"{prefix}_obj_{axis}_m" for axis in "xyz"], place)
    _put(row, [f"{prefix}_{name}" for name in ("image_x", "image_y", "log_z")], point)
    _put(row, [f"{prefix}_translation_error_{axis}_m" for axis in "xyz"], error.translation)
    row[f"{prefix}_translation_error_m"] = error.distance
    _put(row, [f"{prefix}_rotation_error_{axis}_rad" for axis in "xyz"], error.rotation)
    row[f"{prefix}_rotation_error_rad"] = error.angle
    return row


def _put(row: Row, names: str | list[str], values: Float[np.ndarray, "C"]) -> None:
    keys = names.split() if isinstance(names, str) else names
    row.update(zip(keys, map(float, values), strict=True))


def _text(value: float | str) -> str:
    return value if isinstance(value, str) else f"{value:.6g}"
