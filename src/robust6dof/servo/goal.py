"""Where the object should appear in the camera."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from robust6dof.errors import DataError, InputError
from robust6dof.geometry.transforms import check_transform, make_transform, rotation_about_y

MAX_TILT = np.deg2rad(60.0)
"""A goal camera may look this far from straight down [rad]; the default arm reaches it."""


def look_down_goal(
    standoff: float = 0.5, yaw: float = 0.0, tilt: float = 0.0
) -> Float[np.ndarray, "4 4"]:
    """T_cam_obj_goal of a camera that looks down on an upright object, in the image's middle.

    Args:
        standoff: from the camera to the object's centre [m].
        yaw: turn of the object about its y axis [rad]; at 0 its x axis points right in the image
            and its z axis down.
        tilt: of the camera's axis from straight down [rad]. The camera then sees the side that
            was at the bottom of the image, and the object's up leans to the image's top.

    Raises:
        InputError: a stand-off that is not positive, or a tilt outside 0 to 60°.
    """
    if not standoff > 0:
        raise InputError(f"the stand-off must be positive [m], got {standoff}")
    if not 0 <= tilt <= MAX_TILT:
        raise InputError(f"the goal's tilt must be 0 to 60°, got {np.degrees(tilt):.4g}°")
    # Object y (up) towards the camera, x right, z down in the image.
    R = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    R_tilted_straight = Rotation.from_rotvec([-tilt, 0.0, 0.0]).as_matrix()
    R_cam_obj = R_tilted_straight @ R @ rotation_about_y(yaw)
    return make_transform(R_cam_obj, np.array([0.0, 0.0, standoff]))


def read_goal(path: str | Path) -> Float[np.ndarray, "4 4"]:
    """Read T_cam_obj_goal from a text file of four rows of four numbers.

    Raises:
        DataError: unreadable, not 16 numbers, not a rigid transform, or behind the camera.
    """
    path = Path(path)
    remedy = "Write T_cam_obj as four rows of four numbers, metres, OpenCV camera axes"
    try:
        numbers = np.array(path.read_text().replace(",", " ").split(), dtype=np.float64)
    except (OSError, ValueError) as problem:
        raise DataError(path, f"not readable as numbers ({problem})", remedy) from None
    if numbers.size != 16:
        raise DataError(path, f"holds {numbers.size} numbers instead of 16", remedy)
    try:
        T_cam_obj_goal = check_transform(numbers.reshape(4, 4), "the goal")
    except InputError as problem:
        raise DataError(path, str(problem), remedy) from None
    if T_cam_obj_goal[2, 3] <= 0:
        raise DataError(path, "the goal lies behind the camera", remedy)
    return T_cam_obj_goal
