"""Whether an annotated pose can be true: the depth against the posed object's extent."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Bool, Float

from robust6dof.data.dataset import ObjectTruth
from robust6dof.frames import RgbdFrame
from robust6dof.geometry.boxes import box_corners
from robust6dof.geometry.camera import backproject, project
from robust6dof.geometry.transforms import invert_transform, transform_points

MARGIN_M = 0.02
"""A box is taken this much larger on each side, for sensor noise and annotation error [m]."""
SMALLEST_SHARE = 0.5
"""Of a mask's depth at least this much must lie in the posed box."""
FARTHEST_M = 0.3
"""Where the size is unknown, depth may differ from the pose by this much [m]."""


def pose_problem(frame: RgbdFrame, truth: ObjectTruth) -> str | None:
    """Say what contradicts the pose of `truth` in this frame; None where nothing does."""
    T_cam_box = truth.T_cam_box
    if T_cam_box[2, 3] <= 0:
        return f"{truth.name} lies behind the camera (z = {T_cam_box[2, 3]:.3g} m)"
    if T_cam_box[2, 3] > 20:
        return f"{truth.name} lies {T_cam_box[2, 3]:.3g} m away: are its poses in millimetres?"
    x, y = project(T_cam_box[:3, 3], frame.K)
    if not (-0.5 * frame.width < x < 1.5 * frame.width) or not (
        -0.5 * frame.height < y < 1.5 * frame.height
    ):
        return f"{truth.name} projects to ({x:.0f}, {y:.0f}) px, far outside the image"
    if truth.extents is None:
        return _compare_distance(frame, truth)
    return _compare_box(frame, truth, truth.extents)


def _compare_box(
    frame: RgbdFrame, truth: ObjectTruth, extents: Float[np.ndarray, "3"]
) -> str | None:
    """With a mask, its depth must lie in the box. Without, some depth in the box's outline must
    not lie beyond it: occluders are nearer, but nothing can be seen through the object."""
    region = truth.mask if truth.mask is not None else _outline(frame, truth, extents)
    points_cam, _ = backproject(frame.depth, frame.K, region)
    if len(points_cam) < 20:
        return None
    points_box = transform_points(invert_transform(truth.T_cam_box), points_cam)
    inside = (np.abs(points_box) < extents / 2 + MARGIN_M).all(axis=1)
    if truth.mask is not None and inside.mean() < SMALLEST_SHARE:
        distance = np.median(points_cam[:, 2])
        return (
            f"only {inside.mean():.0%} of the depth in {truth.name}'s mask lies in its box; it is "
            f"seen at {distance:.3g} m and posed at {truth.T_cam_box[2, 3]:.3g} m"
        )
    beyond = points_cam[:, 2] > box_corners(truth.T_cam_box, extents)[:, 2].max() + MARGIN_M
    if truth.mask is None and not inside.any() and beyond.mean() > 0.5:
        return f"there is nothing where {truth.name} is posed: the depth there is farther"
    return None


def _outline(
    frame: RgbdFrame, truth: ObjectTruth, extents: Float[np.ndarray, "3"]
) -> Bool[np.ndarray, "H W"]:
    corners_cam = box_corners(truth.T_cam_box, 0.7 * extents)
    pixels = project(corners_cam[corners_cam[:, 2] > 0.02], frame.K)
    region = np.zeros(frame.depth.shape, np.uint8)
    cv2.fillConvexPoly(region, cv2.convexHull(np.rint(pixels).astype(np.int32)), 1)
    return region > 0


def _compare_distance(frame: RgbdFrame, truth: ObjectTruth) -> str | None:
    if truth.mask is None:
        return None
    depth = frame.depth[truth.mask & (frame.depth > 0)]
    z = truth.T_cam_box[2, 3]
    if depth.size < 20 or abs(np.median(depth) - z) < FARTHEST_M:
        return None
    return f"{truth.name} is seen at {np.median(depth):.3g} m but posed at {z:.3g} m"
