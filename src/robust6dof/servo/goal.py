"""Where the object should appear in the camera."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Float

from robust6dof.errors import DataError, InputError
from robust6dof.geometry.transforms import check_transform, make_transform, rotation_about_y


def look_down_goal(standoff: float = 0.5, yaw: float = 0.0) -> Float[np.ndarray, "4 4"]:
    """T_cam_obj_goal of a camera above an upright object that looks straight down on it.

    Args:
        standoff: from the camera to the object's centre [m].
        yaw: turn of the object about its y axis [rad]; at 0 its x axis points right in the image
            and its z axis down.

    Raises:
        InputError: a stand-off that is not positive.
    """
    if not standoff > 0:
        raise InputError(f"the stand-off must be positive [m], got {standoff}")
    # Object y (up) towards the camera, x right, z down in the image.
    R = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    return make_transform(R @ rotation_about_y(yaw), np.array([0.0, 0.0, standoff]))


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
