"""Which views the arm can take while the vehicle hovers, and in which posture.

The vehicle can be anywhere and face anywhere, but it hovers level. So a wanted camera pose is
reachable when the arm can bring the world's up direction to where the camera wants it: two
angles, whatever the yaw. Arms that cannot roll (OpenMANIPULATOR-X) reach only a curve of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.optimize import least_squares

from robust6dof.geometry.transforms import invert_transform
from robust6dof.robot.aerial_manipulator import AerialManipulator

UP_WORLD = np.array([0.0, 0.0, 1.0])
UP_OBJ = np.array([0.0, 1.0, 0.0])
"""The canonical object's up direction, for an object that stands upright."""


@dataclass(frozen=True, eq=False)
class Reach:
    """The best posture for a wanted view."""

    reachable: bool
    joints: Float[np.ndarray, "N"]
    """[rad]"""
    angle_off: float
    """How far the camera stays off the wanted view with the vehicle level [rad]."""
    manipulability: float
    """Of that posture; near 0 the arm cannot turn the camera every way."""


def reach_view(
    robot: AerialManipulator,
    up_cam: Float[np.ndarray, "3"],
    *,
    tolerance: float = 0.01,
    starts: int = 8,
) -> Reach:
    """The posture nearest to rest in which world up lies along `up_cam` in the camera.

    Args:
        up_cam: unit vector in the wanted camera's axes.
        tolerance: angle off [rad] that still counts as reached.
        starts: postures the search starts from (rest first, then a fixed random set).
    """
    arm = robot.arm
    rng = np.random.default_rng(0)
    first = [np.clip(arm.rest, arm.lower + 1e-6, arm.upper - 1e-6)]
    others = rng.uniform(arm.lower, arm.upper, (starts - 1, len(arm.joints)))
    best = arm.rest, np.inf
    for start in (*first, *others):
        joints = _search(robot, up_cam, start)
        off = _angle_off(robot, joints, up_cam)
        if off < best[1] - 1e-6:
            best = joints, off
        if best[1] < tolerance:
            break
    joints, off = best
    return Reach(off < tolerance, joints, off, robot.manipulability(joints))


def reach_goal(
    robot: AerialManipulator,
    T_cam_obj_goal: Float[np.ndarray, "4 4"],
    up_obj: Float[np.ndarray, "3"] = UP_OBJ,
) -> Reach:
    """Whether a goal can be held over an object that stands with `up_obj` upwards."""
    return reach_view(robot, T_cam_obj_goal[:3, :3] @ up_obj)


def hover_with_camera_at(
    robot: AerialManipulator, T_world_cam: Float[np.ndarray, "4 4"]
) -> tuple[Float[np.ndarray, "4 4"], Reach]:
    """T_world_body of a level vehicle whose camera is at `T_world_cam`, and the arm's posture.

    Where the view is not reachable the vehicle comes out tilted by `angle_off`.
    """
    reach = reach_view(robot, T_world_cam[:3, :3].T @ UP_WORLD)
    return T_world_cam @ invert_transform(robot.T_body_cam(reach.joints)), reach


def _search(
    robot: AerialManipulator, up_cam: Float[np.ndarray, "3"], start: Float[np.ndarray, "N"]
) -> Float[np.ndarray, "N"]:
    rest_weight = 1e-3  # only chooses among postures that see the same

    def residuals(joints: np.ndarray) -> np.ndarray:
        up = robot.T_body_cam(joints)[2, :3]
        return np.concatenate([up - up_cam, rest_weight * (joints - robot.arm.rest)])

    result = least_squares(residuals, start, bounds=(robot.arm.lower, robot.arm.upper))
    return np.asarray(result.x, dtype=np.float64)


def _angle_off(
    robot: AerialManipulator, joints: Float[np.ndarray, "N"], up_cam: Float[np.ndarray, "3"]
) -> float:
    up = robot.T_body_cam(joints)[2, :3]
    return float(np.arctan2(np.linalg.norm(np.cross(up, up_cam)), up @ up_cam))
