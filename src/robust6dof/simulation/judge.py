"""What simulation truth says: distance from the goal, and of an estimate from the truth."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from robust6dof.geometry.transforms import orientation_error
from robust6dof.servo.config import PadServoConfig
from robust6dof.servo.interaction import rotation_error_vector


@dataclass(frozen=True, eq=False)
class GoalError:
    """How far a pose is from the goal."""

    translation: Float[np.ndarray, "3"]
    """T − T*, camera axes [m]."""
    rotation: Float[np.ndarray, "3"]
    """θu of c*R_c [rad]; for a symmetric object about the nearest of its equal rotations."""

    @property
    def distance(self) -> float:
        """‖T − T*‖ [m]."""
        return float(np.linalg.norm(self.translation))

    @property
    def angle(self) -> float:
        """θ [rad]; for a symmetric object the angle of its axis."""
        return float(np.linalg.norm(self.rotation))

    def within(self, delta_R: float, delta_T: float) -> bool:
        """Whether both errors are below their thresholds [rad, m]."""
        return self.angle < delta_R and self.distance < delta_T

    @staticmethod
    def unknown() -> GoalError:
        """Where there is no pose."""
        return GoalError(np.full(3, np.nan), np.full(3, np.nan))


@dataclass(frozen=True)
class Arrival:
    """The stop test: both errors below their thresholds, and not lost again while held.

    Crossing the thresholds for a moment is no arrival: it counts from the moment after which both
    errors stay below `hysteresis` times their thresholds for `hold` seconds.
    """

    config: PadServoConfig
    hold: float
    """[s]"""
    since: float | None = None
    """Start of the present stay at the goal [s]."""
    first: float | None = None
    """Start of the first stay that lasted [s]."""
    is_held: bool = False
    """Whether the present stay has lasted."""

    def seen(self, now: float, error: GoalError) -> Arrival:
        """Take in the error at time `now` [s]."""
        config, slack = self.config, self.config.hysteresis
        since = self.since
        if since is not None and not error.within(slack * config.delta_R, slack * config.delta_T):
            since = None
        if since is None and error.within(config.delta_R, config.delta_T):
            since = now
        is_held = since is not None and now >= since + self.hold - 1e-9
        first = since if self.first is None and is_held else self.first
        return replace(self, since=since, first=first, is_held=is_held)


def goal_error(
    T_cam_obj: Float[np.ndarray, "4 4"] | None,
    T_cam_obj_goal: Float[np.ndarray, "4 4"],
    symmetric: bool,
) -> GoalError:
    """Compare a pose with the goal; unknown without a pose."""
    if T_cam_obj is None or not np.isfinite(T_cam_obj).all():
        return GoalError.unknown()
    theta_u = rotation_error_vector(T_cam_obj[:3, :3], T_cam_obj_goal[:3, :3], symmetric=symmetric)
    return GoalError(T_cam_obj[:3, 3] - T_cam_obj_goal[:3, 3], theta_u)


def tracking_error(
    T_estimated: Float[np.ndarray, "4 4"], T_true: Float[np.ndarray, "4 4"], symmetric: bool
) -> tuple[float, float]:
    """Angle [rad] (of the axis, for a symmetric object) and distance [m] from the truth."""
    angle = orientation_error(T_estimated[:3, :3], T_true[:3, :3], symmetric)
    return angle, float(np.linalg.norm(T_estimated[:3, 3] - T_true[:3, 3]))
