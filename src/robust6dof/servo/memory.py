"""What the servo carries from step to step, and which poses it lets in."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from robust6dof.errors import InputError
from robust6dof.geometry.transforms import check_transform, orientation_error
from robust6dof.servo.config import PadServoConfig
from robust6dof.servo.following import Following
from robust6dof.servo.safety import SafetyLimits, ServoState
from robust6dof.servo.target_motion import (
    TargetMotion,
    carry_motion,
    correct_motion,
    predict_motion,
    start_motion,
)

MIN_DEPTH = 0.02
"""An object nearer than this along the optical axis [m] counts as not seen."""

_JUMP_GAP_S = 0.2
"""However long ago the last pose was, no more than this time's motion is taken on trust."""

_KEEP_S = 0.6
"""How long the camera's own motion is remembered; more than any image's latency."""


@dataclass(frozen=True, eq=False)
class ServoMemory:
    """Everything the next step needs. Immutable."""

    T_cam_obj: Float[np.ndarray, "4 4"]
    """The last believed pose."""
    stamp: float
    """When it was taken [s]; −inf before the first."""
    doubted: Float[np.ndarray, "4 4"]
    """The latest pose that jumped."""
    doubted_stamp: float
    doubted_count: int
    """How many poses in a row agree with it."""
    command: Float[np.ndarray, "M"]
    """The last command (v_x, v_y, v_z, ω_z, joint rates)."""
    command_time: float
    following: Following
    """How the vehicle keeps up."""
    readiness: float
    """From 0 when guidance begins to 1 when the law is fully in force."""
    reached: bool
    motion: TargetMotion | None
    """The target's motion at `stamp`."""
    own_motion: tuple[tuple[float, Float[np.ndarray, "6"]], ...]
    """Recent (time, camera twist), each holding until the next."""
    now: float
    """Time of the last step [s]."""

    @classmethod
    def blank(cls, joints: int) -> ServoMemory:
        none = -np.inf
        return cls(
            np.eye(4), none, np.eye(4), none, 0, np.zeros(4 + joints), none,
            Following.none(), 0.0, False, None, (), none,
        )  # fmt: skip

    def camera_twist(self, start: float, end: float) -> Float[np.ndarray, "6"]:
        """Mean twist of the camera between two times, as far as it is remembered."""
        if not self.own_motion:
            return np.zeros(6)
        times = np.array([time for time, _ in self.own_motion])
        twists = np.stack([twist for _, twist in self.own_motion])
        # A twist is read at the end of the period it describes.
        edges = np.concatenate([[min(start, times[0])], times])
        edges[-1] = max(edges[-1], end)
        spans = np.clip(np.minimum(edges[1:], end) - np.maximum(edges[:-1], start), 0.0, None)
        if spans.sum() <= 0:
            return twists[-1]
        return spans @ twists / spans.sum()

    def target_now(
        self, config: PadServoConfig, *, symmetric: bool
    ) -> tuple[Float[np.ndarray, "4 4"], Float[np.ndarray, "6"], Float[np.ndarray, "3"]]:
        """The believed pose carried on to now over the image's latency; the target's twist and
        acceleration over ground, camera axes.

        The velocity is that of half a period ahead, the mean until the next command.
        """
        if self.motion is None:
            return self.T_cam_obj, np.zeros(6), np.zeros(3)
        own = self.camera_twist(self.stamp, self.now)
        seen = replace(self.motion, T_cam_obj=self.T_cam_obj)
        latency = max(self.now - self.stamp, 0.0)
        target = carry_motion(seen, own, latency, config.noise.maneuver_time)
        twist = target.twist.copy()
        twist[:3] += target.acceleration * config.period / 2
        if symmetric:  # its spin about its own axis is neither seen nor followed
            y = target.T_cam_obj[:3, 1]
            twist[3:] -= y * (y @ twist[3:])
        in_view = target.T_cam_obj[2, 3] > MIN_DEPTH
        return target.T_cam_obj if in_view else self.T_cam_obj, twist, target.acceleration


def admit(
    memory: ServoMemory,
    T_cam_obj: np.ndarray | None,
    stamp: float,
    now: float,
    camera_twist: Float[np.ndarray, "6"],
    config: PadServoConfig,
    *,
    symmetric: bool,
) -> tuple[ServoMemory, ServoState | None]:
    """Let a pose into the memory, or say why the vehicle must hold.

    Returns:
        The new memory, and the state to hold in (None: go on guiding).
    """
    limits = config.limits
    recent = [(t, V) for t, V in memory.own_motion if now - _KEEP_S <= t < now]
    memory = replace(memory, own_motion=(*recent, (now, camera_twist)), now=now)
    if T_cam_obj is None:
        return memory, ServoState.HOLD_LOST
    T = _usable(T_cam_obj)
    if T is None or not np.isfinite(stamp):
        return memory, ServoState.HOLD_INVALID
    if T[2, 3] <= MIN_DEPTH:
        return memory, ServoState.HOLD_LOST
    if stamp < memory.stamp - limits.stale_after:  # the clock was set back: begin anew
        return ServoMemory.blank(len(memory.command) - 4), ServoState.HOLD_STALE
    if now - stamp > limits.stale_after or stamp < memory.stamp:
        return memory, ServoState.HOLD_STALE
    if stamp == memory.stamp:  # the same image again
        return memory, None
    if np.isfinite(memory.stamp) and _jumped(
        memory.T_cam_obj, T, stamp - memory.stamp, limits, symmetric
    ):
        memory = _doubt(memory, T, stamp, limits, symmetric)
        if memory.doubted_count < limits.accept_after:
            return memory, ServoState.HOLD_JUMP
        memory = replace(memory, motion=None)
    return _believe(memory, T, stamp, config, symmetric), None


def _usable(T_cam_obj: np.ndarray) -> Float[np.ndarray, "4 4"] | None:
    try:
        return check_transform(T_cam_obj, "T_cam_obj")
    except InputError:
        return None


def _jumped(
    before: np.ndarray, T: np.ndarray, dt: float, limits: SafetyLimits, symmetric: bool
) -> bool:
    dt = min(dt, _JUMP_GAP_S)
    distance = float(np.linalg.norm(T[:3, 3] - before[:3, 3]))
    angle = orientation_error(before[:3, :3], T[:3, :3], symmetric)
    return (
        distance > limits.jump_distance + limits.jump_speed * dt
        or angle > limits.jump_angle + limits.jump_turn * dt
    )


def _doubt(
    memory: ServoMemory, T: np.ndarray, stamp: float, limits: SafetyLimits, symmetric: bool
) -> ServoMemory:
    """Count how many jumped poses in a row agree with each other."""
    agrees = np.isfinite(memory.doubted_stamp) and not _jumped(
        memory.doubted, T, stamp - memory.doubted_stamp, limits, symmetric
    )
    count = memory.doubted_count + 1 if agrees else 1
    return replace(memory, doubted=T, doubted_stamp=stamp, doubted_count=count)


def _believe(
    memory: ServoMemory, T: np.ndarray, stamp: float, config: PadServoConfig, symmetric: bool
) -> ServoMemory:
    gap = stamp - memory.stamp
    if config.law != "feedforward":
        motion = None
    elif memory.motion is None or gap > _KEEP_S:
        motion = start_motion(T, config.noise)
    else:
        own = memory.camera_twist(memory.stamp, stamp)
        motion = predict_motion(memory.motion, own, gap, config.noise)
        motion = correct_motion(motion, T, config.noise, symmetric=symmetric)
    return replace(
        memory, T_cam_obj=T, stamp=stamp, motion=motion,
        doubted_stamp=-np.inf, doubted_count=0,
    )  # fmt: skip
