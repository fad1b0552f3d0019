"""The part of a frame where the object is expected: no true mask is ever needed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from robust6dof.frames import RgbdFrame
from robust6dof.geometry.boxes import box_corners
from robust6dof.geometry.camera import project

NEAREST_M = 0.08
"""Depth below this is taken for noise of the sensor [m]."""


@dataclass(frozen=True, eq=False)
class Region:
    """Pixels of a rectangle, thinned by a stride, lifted to camera-frame points."""

    points_cam: Float[np.ndarray, "P 3"]
    pixels: Int[np.ndarray, "P 2"]
    """(x, y) of each point."""


def box_rectangle(
    frame: RgbdFrame,
    T_cam_obj: Float[np.ndarray, "4 4"],
    extents: Float[np.ndarray, "3"],
) -> tuple[int, int, int, int] | None:
    """The image rectangle (x0, y0, x1, y1), ends exclusive, around the projected box.

    None when the box is behind the camera or outside the image.
    """
    corners = box_corners(T_cam_obj, extents)
    if T_cam_obj[2, 3] < NEAREST_M:
        return None
    corners[:, 2] = np.maximum(corners[:, 2], 0.25 * T_cam_obj[2, 3])
    pixels = project(corners, frame.K)
    low = np.clip(np.floor(pixels.min(axis=0)), 0, [frame.width, frame.height]).astype(int)
    high = np.clip(np.ceil(pixels.max(axis=0)) + 1, 0, [frame.width, frame.height]).astype(int)
    if (high <= low).any():
        return None
    return int(low[0]), int(low[1]), int(high[0]), int(high[1])


def cut_region(
    frame: RgbdFrame,
    T_cam_obj: Float[np.ndarray, "4 4"],
    extents: Float[np.ndarray, "3"],
    *,
    max_points: int = 4000,
) -> Region | None:
    """Points of the frame inside the rectangle of a box at `T_cam_obj`, at most about
    `max_points` of them; None when the box is out of view."""
    rectangle = box_rectangle(frame, T_cam_obj, extents)
    if rectangle is None:
        return None
    x0, y0, x1, y1 = rectangle
    stride = max(1, int(np.ceil(np.sqrt((x1 - x0) * (y1 - y0) / max_points))))
    depth = frame.depth[y0:y1:stride, x0:x1:stride]
    y, x = np.nonzero(np.isfinite(depth) & (depth > NEAREST_M))
    z = depth[y, x].astype(np.float64)
    pixels = np.stack([x0 + stride * x, y0 + stride * y], axis=-1)
    rays = (pixels - frame.K[:2, 2]) / np.diag(frame.K)[:2]
    return Region(np.column_stack([rays * z[:, None], z]), pixels)


def valid_depth(frame: RgbdFrame) -> Bool[np.ndarray, "H W"]:
    """Pixels with usable depth."""
    return np.isfinite(frame.depth) & (frame.depth > NEAREST_M)


def depth_noise(z: np.ndarray | float) -> np.ndarray:
    """Standard deviation [m] expected of a stereo or structured-light depth at distance z [m].

    The disparity model σ = z² δ / (f b), with δ / (f b) = 0.0025 / m as for a D435i or Kinect v1.
    """
    return np.asarray(0.0025 * np.square(np.asarray(z, dtype=np.float64)))
