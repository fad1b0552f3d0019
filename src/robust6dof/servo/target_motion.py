"""How the target moves over ground, from its poses in the camera and the camera's own motion.

A Kalman filter in camera axes. With the camera's own twist (v, ω) known, the object's centre p,
velocity v_o and acceleration a_o (over ground, in camera axes) move as

    ṗ = v_o − v − ω × p,   v̇_o = a_o − ω × v_o,   ȧ_o = −a_o/τ + (ω_o − ω) × a_o + white jerk

(Singer's model of a manoeuvring target, 1970, whose acceleration turns with it), and the rotation
R_cam_obj and angular velocity ω_o as Ṙ = [ω_o − ω]× R, ω̇_o = −ω × ω_o + white angular
acceleration. Noise is the same along every axis and turning keeps it so: one covariance serves the
three axes of each.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from robust6dof.geometry.transforms import make_transform
from robust6dof.servo.interaction import nearest_symmetric_turn


@dataclass(frozen=True)
class TargetMotionNoise:
    """What the filter assumes (standard deviations; densities for the white accelerations)."""

    position: float = 0.003
    """Of a measured position [m]."""
    rotation: float = 0.03
    """Of a measured rotation about any axis [rad]."""
    acceleration: float = 0.5
    """Of the target's acceleration [m/s²]."""
    maneuver_time: float = 2.0
    """τ: how long an acceleration typically lasts [s]."""
    angular_acceleration: float = 0.1
    """Of the target's angular acceleration, density [rad/s² per √Hz]."""
    own_speed: float = 0.01
    """Of the camera's own linear velocity as told [m/s]."""
    own_turn: float = 0.01
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
    acceleration: Float[np.ndarray, "3"]
    """a_o over ground in camera axes [m/s²]."""
    linear_covariance: Float[np.ndarray, "3 3"]
    """Of (position, velocity, acceleration) along any axis."""
    angular_covariance: Float[np.ndarray, "2 2"]
    """Of (angle, angular velocity) about any axis."""


def start_motion(T_cam_obj: Float[np.ndarray, "4 4"], noise: TargetMotionNoise) -> TargetMotion:
    """Begin with a target thought to stand."""
    return TargetMotion(
        T_cam_obj,
        np.zeros(6),
        np.zeros(3),
        np.diag([noise.position, noise.first_speed, noise.acceleration]) ** 2,
        np.diag([noise.rotation, noise.first_turn]) ** 2,
    )


def carry_motion(
    motion: TargetMotion, camera_twist: Float[np.ndarray, "6"], dt: float, maneuver_time: float
) -> TargetMotion:
    """The mean `dt` seconds on, in the camera's new axes; covariances as they are."""
    back = Rotation.from_rotvec(-camera_twist[3:] * dt).as_matrix()  # R_new_old
    v, omega, a = motion.twist[:3], motion.twist[3:], motion.acceleration
    halfway = Rotation.from_rotvec(camera_twist[3:] * dt / 2).as_matrix()
    t = motion.T_cam_obj[:3, 3] + (v - halfway @ camera_twist[:3]) * dt + a * dt**2 / 2
    spin = Rotation.from_rotvec(omega * dt).as_matrix()
    return replace(
        motion,
        T_cam_obj=make_transform(back @ spin @ motion.T_cam_obj[:3, :3], back @ t),
        twist=np.concatenate([back @ (v + a * dt), back @ omega]),
        acceleration=back @ spin @ a * np.exp(-dt / maneuver_time),
    )


def predict_motion(
    motion: TargetMotion, camera_twist: Float[np.ndarray, "6"], dt: float, noise: TargetMotionNoise
) -> TargetMotion:
    """Carry the estimate `dt` seconds on while the camera moves with `camera_twist` (own axes)."""
    carried = carry_motion(motion, camera_twist, dt, noise.maneuver_time)
    decay = np.exp(-dt / noise.maneuver_time)
    F = np.array([[1.0, dt, dt**2 / 2], [0.0, 1.0, dt], [0.0, 0.0, decay]])
    G = np.array([[1.0, dt], [0.0, 1.0]])
    return replace(
        carried,
        linear_covariance=F @ motion.linear_covariance @ F.T + _linear_growth(dt, noise),
        angular_covariance=G @ motion.angular_covariance @ G.T + _angular_growth(dt, noise),
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
    R, R_seen = motion.T_cam_obj[:3, :3], T_cam_obj[:3, :3]
    if symmetric:
        R_seen = R_seen @ nearest_symmetric_turn(R_seen, R)
    turn = Rotation.from_matrix(R_seen @ R.T).as_rotvec()
    return TargetMotion(
        make_transform(
            Rotation.from_rotvec(gain_r[0] * turn).as_matrix() @ R,
            motion.T_cam_obj[:3, 3] + gain_p[0] * off,
        ),
        motion.twist + np.concatenate([gain_p[1] * off, gain_r[1] * turn]),
        motion.acceleration + gain_p[2] * off,
        linear_covariance,
        angular_covariance,
    )


def _linear_growth(dt: float, noise: TargetMotionNoise) -> Float[np.ndarray, "3 3"]:
    """White jerk that keeps the acceleration at its standard deviation, and own speed's error."""
    q = 2 * noise.acceleration**2 / noise.maneuver_time
    Q = q * np.array(
        [
            [dt**5 / 20, dt**4 / 8, dt**3 / 6],
            [dt**4 / 8, dt**3 / 3, dt**2 / 2],
            [dt**3 / 6, dt**2 / 2, dt],
        ]
    )
    Q[0, 0] += (noise.own_speed * dt) ** 2
    return Q


def _angular_growth(dt: float, noise: TargetMotionNoise) -> Float[np.ndarray, "2 2"]:
    Q = noise.angular_acceleration**2 * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
    Q[0, 0] += (noise.own_turn * dt) ** 2
    return Q


def _correct(
    covariance: Float[np.ndarray, "n n"], noise: float
) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n n"]]:
    """Kalman's gain of a measurement of the first state, and what covariance it leaves."""
    gain = covariance[:, 0] / (covariance[0, 0] + noise**2)
    corrected = covariance - np.outer(gain, covariance[0])
    return gain, (corrected + corrected.T) / 2
