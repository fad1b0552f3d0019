"""From a frame and a predicted pose to the network's input; training goes through the same door."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import torch
from jaxtyping import Float

from robust6dof.frames import RgbdFrame
from robust6dof.geometry.camera import backproject, project
from robust6dof.geometry.transforms import invert_transform, transform_points
from robust6dof.network.inputs import ViewBatch

_CANDIDATES = 32
"""Of a large image window about as many pixels are looked at for each point that is drawn."""

_CORNERS = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])


@dataclass(frozen=True)
class ViewConfig:
    """What is cut out of a frame around the predicted object."""

    points: int = 2048
    """N: observed points, one for each of N pixels."""
    crop_px: int = 192
    """Side of the square colour crop."""
    margin: float = 0.15
    """Room about the predicted box for errors of the prediction, in box diagonals."""
    least_points: int = 12
    """With fewer points near the predicted box there is no view."""


@dataclass(frozen=True, eq=False)
class View:
    """One object in one frame, as the network sees it, with what training needs beside."""

    batch: ViewBatch
    """Batch of one."""
    frame_pixels: Float[np.ndarray, "N 2"]
    """(x, y) of each point in the frame [px]."""


def make_view(
    frame: RgbdFrame,
    T_cam_pred: Float[np.ndarray, "4 4"],
    extents: Float[np.ndarray, "3"],
    config: ViewConfig,
    rng: np.random.Generator,
) -> View | None:
    """Cut out what the prediction says is the object; None where there is too little depth.

    No mask is used: the points are those with valid depth inside the predicted box grown by the
    margin, so some are background, and the network has to tell.

    Args:
        frame: the image.
        T_cam_pred: predicted object frame in the camera (rigid).
        extents: predicted side lengths of the box [m].
        config: sizes.
        rng: draws the N points where there are more; repeats some where there are fewer.
    """
    scale = float(np.linalg.norm(extents))
    window = _crop_window(frame, T_cam_pred, extents + 2 * config.margin * scale)
    if window is None:
        return None
    step = max(1, int((window[2] ** 2 / (_CANDIDATES * config.points)) ** 0.5))
    offset = rng.integers(step, size=2)
    box = (T_cam_pred, extents, scale, config.margin)
    points, pixels = _points_near_box(frame, window, *box, step, offset)
    if step > 1 and len(points) < config.points:
        points, pixels = _points_near_box(frame, window, *box)
    if len(points) < config.least_points:
        return None
    chosen = _choose(len(points), config.points, rng)
    x0, y0, side = window
    zoom = config.crop_px / side
    crop = _crop_color(frame, x0, y0, zoom, config.crop_px)
    batch = ViewBatch(
        points=_row(points[chosen]),
        rgb=_row(crop.transpose(2, 0, 1) / 255.0),
        pixels=_row((pixels[chosen] - [x0, y0] + 0.5) * zoom - 0.5),
        T_cam_pred=_row(T_cam_pred),
        scale=_row(np.array(scale)),
    )
    return View(batch, pixels[chosen])


def _crop_window(
    frame: RgbdFrame, T_cam_pred: np.ndarray, sides: np.ndarray
) -> tuple[float, float, float] | None:
    """Left, top and side [px] of the square about the projected box; None where out of view."""
    corners_cam = transform_points(T_cam_pred, _CORNERS * sides)
    if not np.isfinite(corners_cam).all() or corners_cam[:, 2].min() < 0.02:
        return None
    pixels = project(corners_cam, frame.K)
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    side = float(np.clip((high - low).max(), 16.0, 2.0 * max(frame.width, frame.height)))
    corner = (low + high) / 2 - side / 2
    # A box that nearly reaches the camera can be in view while its cut window is not.
    low, high = np.maximum(low, corner), np.minimum(high, corner + side)
    if np.any(high < 0) or np.any(low > [frame.width - 1, frame.height - 1]):
        return None
    return float(corner[0]), float(corner[1]), side


def _points_near_box(
    frame: RgbdFrame,
    window: tuple[float, float, float],
    T_cam_pred: np.ndarray,
    extents: np.ndarray,
    scale: float,
    margin: float,
    step: int = 1,
    offset: Sequence[int] | np.ndarray = (0, 0),
) -> tuple[np.ndarray, np.ndarray]:
    """Points of every step-th pixel, in the predicted frame over the scale; and their pixels."""
    x0, y0, side = window
    corner = np.maximum(np.floor([x0, y0]), 0).astype(int) + offset
    left, top = corner
    right, bottom = int(np.ceil(x0 + side)) + 1, int(np.ceil(y0 + side)) + 1
    part = frame.depth[top:bottom:step, left:right:step]
    K_part = frame.K.copy()
    K_part[:2, 2] -= corner
    K_part[:2] /= step
    points_cam, pixels = backproject(part, K_part)
    points = transform_points(invert_transform(T_cam_pred), points_cam) / scale
    near = (np.abs(points) <= extents / (2 * scale) + margin).all(axis=1)
    return points[near], pixels[near] * step + corner


def _choose(available: int, count: int, rng: np.random.Generator) -> np.ndarray:
    if available >= count:
        return rng.choice(available, count, replace=False)
    return np.concatenate([np.arange(available), rng.integers(0, available, count - available)])


def _crop_color(frame: RgbdFrame, x0: float, y0: float, zoom: float, crop_px: int) -> np.ndarray:
    if not frame.has_color:
        return np.zeros((crop_px, crop_px, 3), np.uint8)
    source, left, top = frame.rgb, 0, 0
    ratio = np.ones(2)
    if zoom < 0.5:
        # Averaging first keeps a strong reduction from aliasing.
        side, factor = crop_px / zoom, int(1 / zoom)
        left, top = max(int(x0), 0), max(int(y0), 0)
        source = frame.rgb[top : int(y0 + side) + 2, left : int(x0 + side) + 2]
        size = (max(source.shape[1] // factor, 1), max(source.shape[0] // factor, 1))
        ratio = np.array([source.shape[1] / size[0], source.shape[0] / size[1]])
        source = cv2.resize(source, size, interpolation=cv2.INTER_AREA)
    # Source pixel p lies at (p + ½) · ratio − ½ + corner in the frame.
    corner = (ratio - 1) / 2 + [left, top]
    move = (corner + 0.5 - [x0, y0]) * zoom - 0.5
    shift = np.array([[zoom * ratio[0], 0, move[0]], [0, zoom * ratio[1], move[1]]])
    return cv2.warpAffine(source, shift, (crop_px, crop_px), flags=cv2.INTER_LINEAR)


def _row(values: np.ndarray) -> torch.Tensor:
    return torch.from_numpy(np.asarray(values, dtype=np.float32))[None]
