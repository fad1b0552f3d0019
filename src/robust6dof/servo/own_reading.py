"""The robot's own state at one step, checked before anything is made of it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from robust6dof.robot.aerial_manipulator import AerialManipulator
from robust6dof.servo.config import PadServoConfig


@dataclass(frozen=True, eq=False)
class OwnReading:
    """What the robot knows of itself."""

    joints: Float[np.ndarray, "N"]
    """[rad]"""
    tilt_rates: Float[np.ndarray, "2"]
    """(ω_x, ω_y) of the vehicle, clipped [rad/s]."""
    J: Float[np.ndarray, "6 M"]
    """The camera's Jacobian now, Eq. 3."""
    camera_twist: Float[np.ndarray, "6"]
    """Of the camera since the last step, own axes [m/s, rad/s]."""
    velocity: Float[np.ndarray, "3"] | None
    """Of the vehicle as measured, body axes [m/s]; None where it is not told."""
    yaw_rate: float
    """[rad/s]"""
    height: float | None
    """Of the vehicle above ground [m]; None where it is not told."""
    now: float
    """[s]"""


def read_own(
    robot: AerialManipulator,
    config: PadServoConfig,
    command: Float[np.ndarray, "M"],
    joints: np.ndarray,
    tilt_rates: np.ndarray,
    motion: tuple[np.ndarray | None, float | None, np.ndarray | None],
    height: float | None,
    now: float,
) -> OwnReading | None:
    """The readings, checked and clipped; None where one is not finite.

    Args:
        robot: whose.
        config: the servo's.
        command: the last one, taken for what was done where `motion` is not told.
        joints: [rad].
        tilt_rates: (ω_x, ω_y) [rad/s].
        motion: measured velocity of the vehicle [m/s], yaw rate and joint rates [rad/s].
        height: above ground [m].
        now: [s].
    """
    velocity, yaw_rate, joint_rates = motion
    own = np.concatenate(
        [
            command[:3] if velocity is None else velocity,
            command[3:4] if yaw_rate is None else [yaw_rate],
            command[4:] if joint_rates is None else joint_rates,
        ]
    )
    values = np.concatenate([joints, tilt_rates, own, [now, 0.0 if height is None else height]])
    if not np.isfinite(values).all():
        return None
    tilt_rates = np.clip(tilt_rates, -config.max_tilt_rate, config.max_tilt_rate)
    # Rates are means since the last step: they acted on the posture halfway.
    halfway = robot.camera_jacobian(joints - own[4:] * config.period / 2)
    return OwnReading(
        joints,
        tilt_rates,
        robot.camera_jacobian(joints),
        halfway @ np.concatenate([own[:3], tilt_rates, own[3:]]),
        None if velocity is None else own[:3],
        float(own[3]),
        height,
        now,
    )
