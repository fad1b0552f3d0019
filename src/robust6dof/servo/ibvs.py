"""Image-based servoing to compare with: four points of the object, classic interaction matrix."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from robust6dof.geometry.transforms import transform_points
from robust6dof.robot.aerial_manipulator import AerialManipulator
from robust6dof.servo.config import PadServoConfig
from robust6dof.servo.interaction import translation_interaction, turning_interaction
from robust6dof.servo.laws import Sight, solve_task
from robust6dof.servo.least_squares import damped_inverse

POINTS_OBJ = 0.05 * np.array([[1.0, 0, 1.0], [1.0, 0, -1.0], [-1.0, 0, -1.0], [-1.0, 0, 1.0]])
"""A square in the object's horizontal plane [m]."""


def ibvs_law(
    robot: AerialManipulator, sight: Sight, config: PadServoConfig
) -> Float[np.ndarray, "M"]:
    """V_C = −λ_p L⁺ (s − s*), s the four points' (x, y), L at the current points and depths.

    Chaumette & Hutchinson, Visual servo control part I (2006), Eqs. 4–11. Points behind the
    camera stop it.
    """
    points = transform_points(sight.T_cam_obj_turned, POINTS_OBJ)
    goal = transform_points(sight.T_cam_obj_goal, POINTS_OBJ)
    if min(points[:, 2].min(), goal[:, 2].min()) <= 0.01:
        return np.zeros(4 + len(sight.joints))
    error = (points[:, :2] / points[:, 2:] - goal[:, :2] / goal[:, 2:]).ravel()
    L = np.vstack([_image_rows(point) for point in points])
    V = -config.lambda_p * damped_inverse(L, 1e-4, 1e-4) @ error
    return solve_task(robot, sight, config, np.eye(6), V)


def _image_rows(point_cam: Float[np.ndarray, "3"]) -> Float[np.ndarray, "2 6"]:
    x, y = point_cam[:2] / point_cam[2]
    return np.hstack([translation_interaction(point_cam)[:2], turning_interaction(x, y)[:2]])
