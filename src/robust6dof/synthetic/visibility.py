"""What of an object is in view: the truth that protocols ask for."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from robust6dof.geometry.camera import backproject
from robust6dof.geometry.transforms import invert_transform, transform_points
from robust6dof.rendering.scene import Rendering

HANDLE_SHARE = 0.01
"""A mug's handle counts as visible from this share of the mug's visible pixels."""


def visible_surface(
    rendering: Rendering,
    instance_id: int,
    K: Float[np.ndarray, "3 3"],
    T_cam_obj: Float[np.ndarray, "4 4"],
) -> Float[np.ndarray, "P 3"]:
    """Visible points of one instance in its own object frame [m]."""
    points_cam, _ = backproject(rendering.depth, K, rendering.ids == instance_id)
    return transform_points(invert_transform(T_cam_obj), points_cam)


def handle_visible(points_obj: Float[np.ndarray, "P 3"], extents: Float[np.ndarray, "3"]) -> bool:
    """Whether a mug's visible points show its handle.

    The cup is round: it is as wide as the box's z side, and touches the box's handle-free (−x)
    face. What lies beyond that circle towards +x is handle.
    """
    if len(points_obj) == 0:
        return False
    radius = extents[2] / 2
    axis_x = -extents[0] / 2 + radius
    beyond = np.hypot(points_obj[:, 0] - axis_x, points_obj[:, 2]) > 1.06 * radius
    return bool((beyond & (points_obj[:, 0] > axis_x)).mean() >= HANDLE_SHARE)
