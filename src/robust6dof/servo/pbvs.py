"""Pose-based servoing to compare with: the camera goes straight to its goal."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from robust6dof.geometry.transforms import invert_transform
from robust6dof.robot.aerial_manipulator import AerialManipulator
from robust6dof.servo.config import PadServoConfig
from robust6dof.servo.laws import Sight, solve_task


def pbvs_law(
    robot: AerialManipulator, sight: Sight, config: PadServoConfig
) -> Float[np.ndarray, "M"]:
    """v = −λ_p R_cam_goal t_goal_cam, ω = −λ_r θu.

    Chaumette & Hutchinson, Visual servo control part I (2006), Eq. 15, with s = (c*t_c, θu):
    the camera's path is a straight line, and the object may leave the image.
    """
    T_goal_cam = sight.T_cam_obj_goal @ invert_transform(sight.T_cam_obj_turned)
    v = -config.lambda_p * T_goal_cam[:3, :3].T @ T_goal_cam[:3, 3]
    V = np.concatenate([v, -config.lambda_r * sight.rotation_error])
    return solve_task(robot, sight, config, np.eye(6), V)
