"""PAD-Servo's laws: errors → (v_x, v_y, v_z, ω_z, joint rates), before any limit.

With m_e = (X/Z, Y/Z, log Z), ε_p = m_e − m_e*, θu of c*R_c and the measured ∇ = (ω_x, ω_y):

- `printed`: η̇ = J_mr⁺ [0; −λ_r θu];  υ = −J_s⁺ (λ_p L⁺ ε_p + J̄_s ∇).
- `coupled`: [L J_s, L J_mr; J_s^ω, J_mr^ω] (υ, η̇) = (−λ_p ε_p, −λ_r θu) − [L J̄_s; J̄_s^ω] ∇,
  6 equations in 8 unknowns, weighted and damped; the rest posture is preferred.
- `feedforward`: `coupled` with the target's twist (v_o, ω_o) added on the right as
  (L_Z v_o, ω_o).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from robust6dof.geometry.transforms import make_transform
from robust6dof.robot.aerial_manipulator import AerialManipulator
from robust6dof.robot.velocity_transmission import TILT_COLUMNS, VEHICLE_COLUMNS
from robust6dof.servo.config import PadServoConfig
from robust6dof.servo.interaction import (
    extended_image_point,
    nearest_symmetric_turn,
    point_interaction,
    printed_rotation_error_vector,
    rotation_error_vector,
)
from robust6dof.servo.least_squares import bounded_solution, damped_inverse


@dataclass(frozen=True, eq=False)
class Sight:
    """What a law works on: where the object is and should be, and the robot's posture."""

    T_cam_obj: Float[np.ndarray, "4 4"]
    T_cam_obj_goal: Float[np.ndarray, "4 4"]
    joints: Float[np.ndarray, "N"]
    """[rad]"""
    tilt_rates: Float[np.ndarray, "2"]
    """∇: the vehicle's measured (ω_x, ω_y), body frame [rad/s]."""
    J: Float[np.ndarray, "6 M"]
    """The camera's Jacobian at these joints, Eq. 3."""
    symmetric: bool = False
    """Whether turns of the object about its y axis mean nothing."""

    @property
    def J_s(self) -> Float[np.ndarray, "6 4"]:
        """Camera velocity per υ = (v_x, v_y, v_z, ω_z)."""
        return self.J[:, VEHICLE_COLUMNS]

    @property
    def J_s_bar(self) -> Float[np.ndarray, "6 2"]:
        """Camera velocity per ∇."""
        return self.J[:, TILT_COLUMNS]

    @property
    def J_mr(self) -> Float[np.ndarray, "6 N"]:
        """Camera velocity per joint rates."""
        return self.J[:, 6:]

    @property
    def translation_error(self) -> Float[np.ndarray, "3"]:
        """ε_p = m_e − m_e*."""
        return extended_image_point(self.T_cam_obj[:3, 3]) - extended_image_point(
            self.T_cam_obj_goal[:3, 3]
        )

    @property
    def T_cam_obj_turned(self) -> Float[np.ndarray, "4 4"]:
        """The pose; a symmetric object's turned about its y axis to where θ is least."""
        if not self.symmetric:
            return self.T_cam_obj
        R, R_goal = self.T_cam_obj[:3, :3], self.T_cam_obj_goal[:3, :3]
        return make_transform(R @ nearest_symmetric_turn(R, R_goal), self.T_cam_obj[:3, 3])

    @cached_property
    def rotation_error(self) -> Float[np.ndarray, "3"]:
        """θu of c*R_c [rad]."""
        R, R_goal = self.T_cam_obj[:3, :3], self.T_cam_obj_goal[:3, :3]
        return rotation_error_vector(R, R_goal, symmetric=self.symmetric)


def printed_law(
    robot: AerialManipulator, sight: Sight, config: PadServoConfig
) -> Float[np.ndarray, "M"]:
    """Two separate loops: the arm turns the camera, the vehicle moves it (Alg. 1)."""
    theta_u = sight.rotation_error
    if config.rotation_error == "printed":
        theta_u = printed_rotation_error_vector(
            sight.T_cam_obj[:3, :3], sight.T_cam_obj_goal[:3, :3]
        )
    omega = -config.lambda_r * theta_u  # L⁻¹ θu = θu: both printed branches are this one
    if config.rotation_rows == "all":
        joint_rates = _invert(sight.J_mr, config) @ np.concatenate([np.zeros(3), omega])
    else:
        joint_rates = _invert(sight.J_mr[3:], config) @ omega
    L_inverse = _invert(point_interaction(sight.T_cam_obj[:3, 3]), config)
    V_vehicle = -config.lambda_p * L_inverse @ sight.translation_error
    upsilon = _invert(sight.J_s, config) @ (V_vehicle - sight.J_s_bar @ sight.tilt_rates)
    low, high = joint_rate_bounds(robot, sight.joints, config)
    return np.concatenate([upsilon, np.clip(joint_rates, low, high)])


def coupled_law(
    robot: AerialManipulator,
    sight: Sight,
    config: PadServoConfig,
    target_twist: Float[np.ndarray, "6"] | None = None,
) -> Float[np.ndarray, "M"]:
    """Both loops as one system; `feedforward` where the target's twist is given.

    Args:
        target_twist: velocity of the object's centre [m/s] and its angular velocity [rad/s]
            over ground, in camera axes.
    """
    task = np.zeros((6, 6))
    task[:3] = point_interaction(sight.T_cam_obj[:3, 3])
    task[3:, 3:] = np.eye(3)
    wanted = np.concatenate(
        [-config.lambda_p * sight.translation_error, -config.lambda_r * sight.rotation_error]
    )
    if target_twist is not None:
        wanted[:3] += task[:3, :3] @ target_twist[:3]
        wanted[3:] += target_twist[3:]
    return solve_task(robot, sight, config, task, wanted)


def solve_task(
    robot: AerialManipulator,
    sight: Sight,
    config: PadServoConfig,
    task: Float[np.ndarray, "m 6"],
    wanted: Float[np.ndarray, "m"],
) -> Float[np.ndarray, "M"]:
    """Commands whose camera velocity V_C makes task · V_C = wanted, ∇ compensated.

    Free directions pull the arm to its rest posture; a joint near its limit is braked and the
    others make up for it.
    """
    joints = sight.joints
    A = task @ np.hstack([sight.J_s, sight.J_mr])
    low, high = joint_rate_bounds(robot, joints, config)
    b, against_tilt = wanted, np.zeros(len(joints))
    if config.tilt_compensation == "all":
        b = wanted - task @ sight.J_s_bar @ sight.tilt_rates
    else:
        against_tilt = -_invert(sight.J_mr[3:], config) @ sight.J_s_bar[3:] @ sight.tilt_rates
    n = len(joints)
    weights = np.concatenate(
        [np.full(3, config.vehicle_weight), [config.yaw_weight], np.full(n, config.joint_weight)]
    )
    preference = np.concatenate([np.zeros(4), config.rest_gain * (robot.arm.rest - joints)])
    free = np.full(4, np.inf)
    command = bounded_solution(
        A,
        b,
        weights,
        preference,
        np.concatenate([-free, low]),
        np.concatenate([free, high]),
        config.damping,
        config.singular_below,
    )
    command[4:] = np.clip(command[4:] + against_tilt, low, high)
    return command


def joint_rate_bounds(
    robot: AerialManipulator, joints: Float[np.ndarray, "N"], config: PadServoConfig
) -> tuple[Float[np.ndarray, "N"], Float[np.ndarray, "N"]]:
    """Rates [rad/s] that brake every joint before its limit; beyond it only the way back."""
    gain = min(config.joint_brake, config.rate_hz)
    low = -gain * np.maximum(joints - robot.arm.lower, 0.0)
    high = gain * np.maximum(robot.arm.upper - joints, 0.0)
    return low, high


def _invert(A: Float[np.ndarray, "m n"], config: PadServoConfig) -> Float[np.ndarray, "n m"]:
    return damped_inverse(A, config.damping, config.singular_below)
