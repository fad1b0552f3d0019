"""SIFT features in an image, with their place in space, and what they match in a past one."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, Int

from robust6dof.frames import RgbdFrame
from robust6dof.geometry.transforms import transform_points
from robust6dof.tracking.region import NEAREST_M

_ALIKE = 0.01
"""Descriptors nearer than this to each other are not told apart."""


@dataclass(frozen=True)
class FeatureConfig:
    """How features are found and matched."""

    side_px: int = 320
    """The rectangle is scaled to this, so that small objects have features too …"""
    largest_scale: float = 2.5
    """… but by no more than this."""
    most: int = 350
    """Features at most, the strongest."""
    contrast: float = 0.015
    """SIFT's contrast threshold: low, since everyday objects have little texture."""
    ratio: float = 0.9
    """A match must be this much nearer than the second nearest (Lowe's test)."""
    edge_m: float = 0.02
    """A feature whose neighbouring pixels differ more in depth lies on an outline: no place."""


@dataclass(frozen=True, eq=False)
class Features:
    """Places and descriptors (RootSIFT)."""

    points: Float[np.ndarray, "P 3"]
    """[m]; in the camera's frame or the object's, as the user says."""
    descriptors: Float32[np.ndarray, "P 128"]
    pixels: Int[np.ndarray, "P 2"]
    """(x, y) in the image."""

    @classmethod
    def none(cls) -> Features:
        return cls(np.zeros((0, 3)), np.zeros((0, 128), np.float32), np.zeros((0, 2), int))

    def __len__(self) -> int:
        return len(self.points)

    def __getitem__(self, index: np.ndarray) -> Features:
        return Features(self.points[index], self.descriptors[index], self.pixels[index])

    def moved(self, T_dst_src: Float[np.ndarray, "4 4"]) -> Features:
        """In another frame."""
        return replace(self, points=transform_points(T_dst_src, self.points))


def detect_features(
    frame: RgbdFrame, rectangle: tuple[int, int, int, int], config: FeatureConfig
) -> Features:
    """Those with depth in a rectangle (x0, y0, x1, y1) of the image, in the camera's frame; none
    without colour."""
    if not frame.has_color:
        return Features.none()
    pixels, descriptors = _describe(frame, rectangle, config)
    points, known = _lift(frame, pixels, config.edge_m)
    return Features(points, descriptors, pixels)[known]


def _describe(
    frame: RgbdFrame, rectangle: tuple[int, int, int, int], config: FeatureConfig
) -> tuple[Int[np.ndarray, "P 2"], Float32[np.ndarray, "P 128"]]:
    """Pixels (x, y) and RootSIFT descriptors (Arandjelović, Zisserman 2012)."""
    x0, y0, x1, y1 = rectangle
    grey = cv2.cvtColor(frame.rgb[y0:y1, x0:x1], cv2.COLOR_RGB2GRAY)
    scale = min(config.side_px / max(grey.shape), config.largest_scale)
    grey = cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_LINEAR)
    sift = cv2.SIFT.create(config.most, contrastThreshold=config.contrast)
    corners, found = sift.detectAndCompute(grey, None)
    if found is None or not len(corners):
        return np.zeros((0, 2), int), np.zeros((0, 128), np.float32)
    places = np.array([corner.pt for corner in corners]) / scale
    pixels = np.clip(np.rint(places).astype(int), 0, [x1 - x0 - 1, y1 - y0 - 1]) + [x0, y0]
    root = np.sqrt(found / np.maximum(found.sum(axis=1, keepdims=True), 1e-9))
    return pixels, root.astype(np.float32)


def _lift(
    frame: RgbdFrame, pixels: Int[np.ndarray, "P 2"], edge_m: float
) -> tuple[Float[np.ndarray, "P 3"], Bool[np.ndarray, "P"]]:
    """Camera-frame points by the median depth of 3×3 pixels, and which have one."""
    offsets = np.array([[x, y] for x in (-1, 0, 1) for y in (-1, 0, 1)])
    around = np.clip(pixels[:, None] + offsets, 0, [frame.width - 1, frame.height - 1])
    depth = frame.depth[around[..., 1], around[..., 0]].astype(np.float64)
    valid = np.isfinite(depth) & (depth > NEAREST_M)
    known = valid.sum(axis=1) >= 5
    depth = np.where(valid & known[:, None], depth, np.nan)
    depth[~known] = 0.0
    known &= np.nanmax(depth, axis=1) - np.nanmin(depth, axis=1) < edge_m
    z = np.nanmedian(depth, axis=1)
    rays = (pixels - frame.K[:2, 2]) / np.diag(frame.K)[:2]
    return np.column_stack([rays * z[:, None], z]), known


def match(old: Features, new: Features, ratio: float) -> Int[np.ndarray, "M 2"]:
    """Index pairs (old, new): nearest to each other, and clearly nearer than the second."""
    if len(old) < 2 or len(new) < 2:
        return np.zeros((0, 2), int)
    similarity = old.descriptors @ new.descriptors.T
    best = similarity.argmax(axis=1)
    back = similarity.argmax(axis=0)
    rows = np.flatnonzero(back[best] == np.arange(len(old)))
    top = np.sort(similarity[rows], axis=1)[:, -2:]
    distance = np.sqrt(np.maximum(2.0 - 2.0 * top, 0.0)) + _ALIKE  # of unit vectors
    rows = rows[distance[:, 1] < ratio * distance[:, 0]]
    return np.column_stack([rows, best[rows]])
