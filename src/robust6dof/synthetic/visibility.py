"""What of an object is in view: the truth that protocols ask for."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from robust6dof.geometry.camera import backproject
from robust6dof.geometry.transforms import invert_transform, transform_points
from robust6dof.rendering.rasteriser import NEAR_M, render_depth
from robust6dof.rendering.scene import Camera, MeshInstance, Rendering, Scene
from robust6dof.shapes.mesh import TexturedMesh

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


def whole_silhouette(
    mesh: TexturedMesh, T_cam_obj: Float[np.ndarray, "4 4"], camera: Camera
) -> int:
    """Pixels that the object alone would cover, those beyond the image's edges counted in.

    They are counted on the image's own pixel grid, continued to the object's outline but at most
    one image further on each side.
    """
    low, high = _outline_box(transform_points(T_cam_obj, mesh.vertices), camera)
    if (low >= high).any():
        return 0
    K = camera.K.copy()
    K[:2, 2] -= low
    alone = Scene([MeshInstance(mesh, T_cam_obj, 1)])
    width, height = (int(side) for side in high - low)
    _, ids = render_depth(alone, Camera(K, width, height, np.eye(4)))
    return int(ids.sum())


def _outline_box(
    points_cam: Float[np.ndarray, "V 3"], camera: Camera
) -> tuple[Int[np.ndarray, "2"], Int[np.ndarray, "2"]]:
    """First and last-plus-one pixel (column, row) of what may be covered."""
    size = np.array([camera.width, camera.height])
    if points_cam[:, 2].min() <= NEAR_M:
        return -size, 2 * size
    pixels = points_cam @ camera.K[:2].T / points_cam[:, 2:]
    low = np.clip(np.floor(pixels.min(axis=0)), -size, 2 * size)
    high = np.clip(np.ceil(pixels.max(axis=0)) + 1, -size, 2 * size)
    return low.astype(np.int64), high.astype(np.int64)
