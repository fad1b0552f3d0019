"""Planes in one image: the largest, and the one around a marked object."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

from robust6dof.frames import RgbdFrame
from robust6dof.geometry.camera import backproject
from robust6dof.tracking.region import depth_noise, valid_depth
from robust6dof.tracking.support_plane import Plane, fit_plane


def local_plane(
    frame: RgbdFrame,
    inside: Bool[np.ndarray, "H W"],
    seed: int = 0,
    *,
    is_object: bool = True,
) -> Plane | None:
    """The plane around (and under) marked pixels, in the camera frame; None if there is none.

    Of the largest planes around, the first that the marked points stand on. `is_object`: the
    marked pixels are the object's own, so the plane is looked for beside them only.
    """
    marked, _ = backproject(frame.depth, frame.K, inside & valid_depth(frame))
    points = _surroundings(frame, inside, marked, is_object)
    rng = np.random.default_rng(seed)
    total = len(points)
    for _ in range(3):
        tolerance = 0.004 + depth_noise(points[:, 2])
        found = fit_plane(points, rng, tolerance=tolerance, trials=200)
        if found is None or found[1].sum() < 0.1 * total:
            return None
        heights = found[0].height(marked)
        stands = -0.015 < np.percentile(heights, 5) < 0.05 and np.percentile(heights, 98) > 0.01
        if stands:
            return found[0]
        points = points[~found[1]]
    return None


def _surroundings(
    frame: RgbdFrame, inside: np.ndarray, marked: np.ndarray, is_object: bool
) -> Float[np.ndarray, "P 3"]:
    """Points around marked pixels, in the image and in depth; a few thousand."""
    y, x = np.nonzero(inside)
    grow = int(max(20, 0.5 * max(np.ptp(x), np.ptp(y))))
    around = np.zeros_like(inside)
    rows = slice(max(y.min() - grow, 0), y.max() + grow + 1)
    columns = slice(max(x.min() - grow, 0), x.max() + grow + 1)
    around[rows, columns] = valid_depth(frame)[rows, columns]
    if is_object:
        around &= ~inside
    low, high = np.percentile(marked[:, 2], [5, 95])
    reach = 0.15 + 2.0 * (high - low)
    around &= np.abs(frame.depth - np.median(marked[:, 2])) < reach
    points, _ = backproject(frame.depth, frame.K, around)
    return points[:: max(1, len(points) // 4000)]


def plane_height(frame: RgbdFrame, plane: Plane) -> Float[np.ndarray, "H W"]:
    """Height of every pixel's point above a camera-frame plane [m]; NaN without depth."""
    x = (np.arange(frame.width) - frame.K[0, 2]) / frame.K[0, 0]
    y = (np.arange(frame.height) - frame.K[1, 2]) / frame.K[1, 1]
    slope = plane.normal[0] * x + (plane.normal[1] * y + plane.normal[2])[:, None]
    depth = np.where(valid_depth(frame), frame.depth, np.nan).astype(np.float64)
    return depth * slope + plane.offset


def image_plane(
    frame: RgbdFrame, free: Bool[np.ndarray, "H W"], rng: np.random.Generator
) -> Plane | None:
    """The largest plane among the free pixels nearer than four metres, in the camera frame."""
    thin = np.zeros_like(free)
    thin[::4, ::4] = free[::4, ::4]
    thin &= frame.depth < 4.0
    points, _ = backproject(frame.depth, frame.K, thin)
    if len(points) < 50:
        return None
    points = points[:: max(1, len(points) // 6000)]
    found = fit_plane(points, rng, tolerance=0.005 + depth_noise(points[:, 2]), trials=200)
    return None if found is None else found[0]
