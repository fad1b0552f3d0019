"""What no command exceeds, and when the vehicle holds instead of following."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from jaxtyping import Float

from robust6dof.errors import InputError


class ServoState(StrEnum):
    """What the servo is doing; every `hold_…` means zero velocity and a still arm."""

    GUIDING = "guiding"
    REACHED = "reached"
    """Both errors are below their thresholds; the law goes on keeping them there."""
    HOLD_LOST = "hold_lost"
    """The tracker has no pose, does not trust it, or puts the object behind the camera."""
    HOLD_STALE = "hold_stale"
    """The pose is too old, or the same image comes again and again."""
    HOLD_JUMP = "hold_jump"
    """The pose changed faster than anything moves."""
    HOLD_INVALID = "hold_invalid"
    """A pose or a reading is NaN, infinite or no rigid transform."""

    @property
    def holding(self) -> bool:
        return self.value.startswith("hold")


@dataclass(frozen=True)
class SafetyLimits:
    """Bounds on commands, and on the poses that may steer them.

    Raises:
        InputError: a limit that is not positive, or a knee outside (0, 1).
    """

    max_speed: float = 1.0
    """Of the vehicle [m/s]."""
    max_yaw_rate: float = 1.0
    """Of the vehicle [rad/s]."""
    max_joint_rate: float = 1.5
    """Of any joint [rad/s]; the arm's own limits hold besides."""
    max_acceleration: float = 2.5
    """Change of the commanded velocity while guiding [m/s²]: the tilt it costs is atan(a/g),
    14° here."""
    knee: float = 0.8
    """Share of a limit up to which commands pass unchanged; beyond, they near it smoothly."""
    min_height: float = 0.3
    """Of the vehicle above ground [m], where its height is told."""
    max_height: float = 10.0
    """Of the vehicle above ground [m], where its height is told."""
    min_distance: float = 0.25
    """Between camera and object's centre [m]: no command brings them closer."""
    brake: float = 1.0
    """Height and distance limits are neared at this rate times what is left [1/s]."""
    stale_after: float = 0.4
    """Age of a pose beyond which the vehicle holds [s]."""
    min_confidence: float = 0.15
    """Below it the tracker counts as lost."""
    jump_distance: float = 0.12
    """A pose may be this far from the one before [m] …"""
    jump_speed: float = 1.5
    """… plus this much per second between the two [m/s]."""
    jump_angle: float = 0.5
    """A pose may be turned this much from the one before [rad] …"""
    jump_turn: float = 3.0
    """… plus this much per second between the two [rad/s]."""
    accept_after: int = 10
    """A jump is believed when this many poses in a row agree with each other."""

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            if not value > 0:
                raise InputError(f"SafetyLimits.{name} must be positive, got {value}")
        if not self.knee < 1:
            raise InputError(f"SafetyLimits.knee must be below 1, got {self.knee}")


def smooth_scale(load: float, knee: float) -> float:
    """Factor ≤ 1 on a command that uses `load` of its limit (1 = all of it).

    1 up to the knee; beyond, load · factor nears 1 smoothly from below (once differentiable).
    """
    if load <= knee:
        return 1.0
    room = 1.0 - knee
    return (knee + room * -np.expm1(-(load - knee) / room)) / load


def saturate(
    command: Float[np.ndarray, "M"], max_joint_rates: Float[np.ndarray, "N"], limits: SafetyLimits
) -> Float[np.ndarray, "M"]:
    """Scale (v_x, v_y, v_z, ω_z, η̇) as one, so that its direction stays, until nothing exceeds."""
    joint_limits = np.minimum(max_joint_rates, limits.max_joint_rate)
    load = max(
        float(np.linalg.norm(command[:3])) / limits.max_speed,
        abs(float(command[3])) / limits.max_yaw_rate,
        float(np.max(np.abs(command[4:]) / joint_limits)),
    )
    return command * smooth_scale(load, limits.knee)


def limit_acceleration(
    command: Float[np.ndarray, "M"],
    before: Float[np.ndarray, "3"],
    dt: float,
    limits: SafetyLimits,
) -> Float[np.ndarray, "M"]:
    """Let the commanded velocity change by no more than max_acceleration · dt."""
    change = command[:3] - before
    size = float(np.linalg.norm(change))
    allowed = limits.max_acceleration * dt
    if size <= allowed:
        return command
    return np.concatenate([before + change * (allowed / size), command[3:]])


def keep_clear(
    command: Float[np.ndarray, "M"],
    t_cam_obj: Float[np.ndarray, "3"],
    J_command: Float[np.ndarray, "3 M"],
    height: float | None,
    limits: SafetyLimits,
) -> Float[np.ndarray, "M"]:
    """Take back what would near the object, the ground or the ceiling too fast.

    Args:
        t_cam_obj: the object in the camera [m].
        J_command: camera's linear velocity per command.
        height: of the vehicle above ground [m], where known; body z is taken for up.
    """
    distance = float(np.linalg.norm(t_cam_obj))
    approach_row = t_cam_obj / distance @ J_command  # speed towards the object, per command
    approach_limit = limits.brake * max(distance - limits.min_distance, 0.0)
    sink_limit, climb_limit = _vertical_limits(height, limits)
    clear = command.copy()
    for _ in range(4):
        excess = float(approach_row @ clear) - approach_limit
        if excess > 0:
            row = approach_row[:3]
            clear[:3] -= excess * row / (row @ row)
        clear[2] = np.clip(clear[2], -sink_limit, climb_limit)
    if float(approach_row @ clear) > approach_limit + 1e-9:
        return np.zeros_like(command)
    return clear


def _vertical_limits(height: float | None, limits: SafetyLimits) -> tuple[float, float]:
    if height is None:
        return np.inf, np.inf
    sink = limits.brake * max(height - limits.min_height, 0.0)
    climb = limits.brake * max(limits.max_height - height, 0.0)
    return sink, climb
