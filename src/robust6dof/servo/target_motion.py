"""How fast the target moves over ground, from its poses in the camera and the camera's motion.

A Kalman filter of constant velocity in camera axes. With the camera's own twist (v, ω) known,
the object's centre p and velocity v_o (over ground, in camera axes) move as

    ṗ = v_o − v − ω × p,     v̇_o = −ω × v_o + white acceleration,

and the rotation R_cam_obj and angular velocity ω_o likewise: Ṙ = [ω_o − ω]× R. Noise is the same
along every axis and turning keeps it so: one 2×2 covariance serves the three axes of each.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation


@dataclass(frozen=True)
class TargetMotionNoise:
    """What the filter assumes (standard deviations; densities for the white accelerations)."""

    position: float = 0.005
    """Of a measured position [m]."""
    rotation: float = 0.03
    """Of a measured rotation about any axis [rad]."""
    acceleration: float = 0.3
    """Of the target's acceleration, density [m/s² per √Hz]."""
    angular_acceleration: float = 0.3
    """Of the target's angular acceleration, density [rad/s² per √Hz]."""
    own_speed: float = 0.03
    """Of the camera's own linear velocity as told [m/s]."""
    own_turn: float = 0.03
    """Of the camera's own angular velocity as told [rad/s]."""
    first_speed: float = 0.3
    """Of the target's speed before anything was seen [m/s]."""
    first_turn: float = 0.3
    """Of the target's angular velocity before anything was seen [rad/s]."""


@dataclass(frozen=True, eq=False)
class TargetMotion:
    """The filter's estimate at one moment. Immutable."""

    T_cam_obj: Float[np.ndarray, "4 4"]
    """Filtered pose."""
    twist: Float[np.ndarray, "6"]
    """(v_o, ω_o) over ground in camera axes [m/s, rad/s]."""
    linear_covariance: Float[np.ndarray, "2 2"]
    """Of (position, velocity) along any axis."""
    angular_covariance: Float[np.ndarray, "2 2"]
    """Of (angle, angular velocity) about any axis."""


def start_motion(T_cam_obj: Float[np.ndarray, "4 4"], noise: TargetMotionNoise) -> TargetMotion:
    """Begin with a target thought to stand."""
    return TargetMotion(
        T_cam_obj,
        np.zeros(6),
        np.diag([noise.position**2, noise.first_speed**2]),
        np.diag([noise.rotation**2, noise.first_turn**2]),
    )


def predict_motion(
    motion: TargetMotion, camera_twist: Float[np.ndarray, "6"], dt: float, noise: TargetMotionNoise
) -> TargetMotion:
    """Carry the estimate `dt` seconds on while the camera moves with `camera_twist` (own axes)."""
    T, twist = move_target(motion.T_cam_obj, motion.twist, camera_twist, dt)
    return TargetMotion(
        T,
        twist,
        _grow(motion.linear_covariance, dt, noise.acceleration, noise.own_speed),
        _grow(motion.angular_covariance, dt, noise.angular_acceleration, noise.own_turn),
    )


def correct_motion(
    motion: TargetMotion,
    T_cam_obj: Float[np.ndarray, "4 4"],
    noise: TargetMotionNoise,
    *,
    symmetric: bool = False,
) -> TargetMotion:
    """Take in a measured pose. For a symmetric object its turn about y carries nothing."""
    gain_p, linear_covariance = _correct(motion.linear_covariance, noise.position)
    gain_r, angular_covariance = _correct(motion.angular_covariance, noise.rotation)
    off = T_cam_obj[:3, 3] - motion.T_cam_obj[:3, 3]
    R = motion.T_cam_obj[:3, :3]
    turn = Rotation.from_matrix(T_cam_obj[:3, :3] @ R.T).as_rotvec()
    if symmetric:
        # The shortest turn between the two axes of symmetry.
        turn = _turn_between(R[:, 1], T_cam_obj[:3, 1])
    T = np.eye(4)
    T[:3, 3] = motion.T_cam_obj[:3, 3] + gain_p[0] * off
    T[:3, :3] = Rotation.from_rotvec(gain_r[0] * turn).as_matrix() @ R
    twist = motion.twist + np.concatenate([gain_p[1] * off, gain_r[1] * turn])
    return TargetMotion(T, twist, linear_covariance, angular_covariance)


def move_target(
    T_cam_obj: Float[np.ndarray, "4 4"],
    target_twist: Float[np.ndarray, "6"],
    camera_twist: Float[np.ndarray, "6"],
    dt: float,
) -> tuple[Float[np.ndarray, "4 4"], Float[np.ndarray, "6"]]:
    """The object's pose and twist after `dt` [s], both twists held over ground.

    Returns:
        T_cam_obj and target_twist, in the camera's new axes.
    """
    back = Rotation.from_rotvec(-camera_twist[3:] * dt).as_matrix()  # R_new_old
    T = np.eye(4)
    T[:3, 3] = back @ (T_cam_obj[:3, 3] + (target_twist[:3] - camera_twist[:3]) * dt)
    spin = Rotation.from_rotvec(target_twist[3:] * dt).as_matrix()
    T[:3, :3] = back @ spin @ T_cam_obj[:3, :3]
    return T, np.concatenate([back @ target_twist[:3], back @ target_twist[3:]])


def _grow(
    covariance: Float[np.ndarray, "2 2"], dt: float, acceleration: float, own: float
) -> Float[np.ndarray, "2 2"]:
    F = np.array([[1.0, dt], [0.0, 1.0]])
    Q = acceleration**2 * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
    Q[0, 0] += (own * dt) ** 2
    return F @ covariance @ F.T + Q


def _correct(
    covariance: Float[np.ndarray, "2 2"], noise: float
) -> tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2 2"]]:
    gain = covariance[:, 0] / (covariance[0, 0] + noise**2)
    corrected = covariance - np.outer(gain, covariance[0])
    return gain, (corrected + corrected.T) / 2


def _turn_between(a: Float[np.ndarray, "3"], b: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
    cross = np.cross(a, b)
    sine = float(np.linalg.norm(cross))
    if sine < 1e-12:
        return np.zeros(3)
    return cross / sine * float(np.arctan2(sine, a @ b))
