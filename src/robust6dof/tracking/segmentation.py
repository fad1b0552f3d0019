"""Which pixels are an object: given masks, depth clusters on a supporting plane, the last pose."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import cv2
import numpy as np
from jaxtyping import Bool, Float

from robust6dof.errors import InputError
from robust6dof.frames import Box, RgbdFrame
from robust6dof.geometry.camera import backproject
from robust6dof.geometry.transforms import invert_transform, transform_points
from robust6dof.tracking.image_plane import image_plane, local_plane, plane_height
from robust6dof.tracking.region import box_rectangle, depth_noise, valid_depth
from robust6dof.tracking.support_plane import Plane


@dataclass(frozen=True, eq=False)
class Segment:
    """One candidate."""

    mask: Bool[np.ndarray, "H W"]
    plane: Plane | None = None
    """What it stands on, in the camera frame, where that is known."""


@runtime_checkable
class Segmenter(Protocol):
    """Finds objects in one frame."""

    def segment(self, frame: RgbdFrame) -> list[Segment]:
        """Candidates, the most prominent first; empty when there is none."""
        ...


@dataclass(frozen=True, eq=False)
class GivenMask:
    """A mask drawn by the user or made by another program."""

    mask: Bool[np.ndarray, "H W"]

    def segment(self, frame: RgbdFrame) -> list[Segment]:
        """The mask itself.

        Raises:
            InputError: of another size than the frame, empty, or without valid depth.
        """
        check_mask_size(self.mask, frame)
        if not self.mask.any():
            raise InputError("the mask is empty; mark the object's pixels in the first frame")
        if not (self.mask & valid_depth(frame)).any():
            raise InputError(
                "there is no valid depth inside the mask; start on a frame where the depth camera "
                "sees the object"
            )
        return [Segment(self.mask)]


def check_mask_size(mask: Bool[np.ndarray, "..."], frame: RgbdFrame) -> None:
    """Raise an InputError where the mask has another size than the frame."""
    if mask.shape != frame.depth.shape:
        raise InputError(
            f"the mask is {mask.shape[1]}×{mask.shape[0]} but the frame is "
            f"{frame.width}×{frame.height}; draw it on the frame itself"
        )


@dataclass(frozen=True)
class DepthClusters:
    """What stands on a plane: RANSAC for the plane, then connected pieces above it.

    Up to `planes` planes are tried, each without the inliers of those before, since the largest
    plane may be the floor or a wall.
    """

    planes: int = 3
    least_plane_share: float = 0.04
    """A plane has at least this share of the valid pixels."""
    least_pixels: int = 120
    """Smaller pieces are noise."""
    height_range_m: tuple[float, float] = (0.015, 0.6)
    """How far a piece's top is above the plane."""
    diagonal_range_m: tuple[float, float] = (0.04, 0.8)
    """Size of a piece."""
    jump_m: float = 0.02
    """Neighbouring pixels whose depths differ by more (besides noise) are apart."""
    seed: int = 0

    def segment(self, frame: RgbdFrame) -> list[Segment]:
        """Pieces, those nearest to the image's centre first."""
        rng = np.random.default_rng(self.seed)
        free = valid_depth(frame)
        total = int(free.sum())
        found: list[Segment] = []
        for _ in range(self.planes):
            plane = image_plane(frame, free, rng)
            if plane is None:
                break
            height = plane_height(frame, plane)
            tolerance = 0.006 + 2.0 * depth_noise(frame.depth)
            on_plane = free & (np.abs(height) < tolerance)
            if on_plane.sum() < self.least_plane_share * total:
                break
            for mask in self._pieces(frame, free, height, on_plane):
                found.append(Segment(mask, plane))
                free &= ~mask
            free &= ~on_plane
        return sorted(found, key=lambda segment: _off_centre(segment.mask))

    def _pieces(
        self, frame: RgbdFrame, free: np.ndarray, height: np.ndarray, on_plane: np.ndarray
    ) -> list[Bool[np.ndarray, "H W"]]:
        clear = 0.005 + 2.0 * depth_noise(frame.depth)
        above = free & (height > clear) & (height < self.height_range_m[1])
        labels = connected_pieces(frame, above, self.jump_m)
        counts = np.bincount(labels.ravel())
        pieces = []
        for label in np.nonzero(counts >= self.least_pixels)[0]:
            mask = labels == label
            if label and self._stands(frame, mask, height, on_plane):
                pieces.append(mask)
        return pieces

    def _stands(
        self, frame: RgbdFrame, mask: np.ndarray, height: np.ndarray, on_plane: np.ndarray
    ) -> bool:
        """The right size, and touching the plane in the image and in space."""
        tops = height[mask]
        if tops.max() < self.height_range_m[0] or np.percentile(tops, 2) > 0.05:
            return False
        points, _ = backproject(frame.depth, frame.K, mask)
        low, high = np.percentile(points, [2, 98], axis=0)
        diagonal = float(np.linalg.norm(high - low))
        if not self.diagonal_range_m[0] < diagonal < self.diagonal_range_m[1]:
            return False
        ring = cv2.dilate(mask.astype(np.uint8), np.ones((15, 15), np.uint8)) > 0
        return bool((ring & on_plane).sum() > 0.15 * (ring & ~mask).sum())


def segment_box(frame: RgbdFrame, box: Box, seed: int = 0) -> Segment:
    """The object inside an image box: what stands clear of the plane around it.

    Raises:
        InputError: the box lies outside the image, or there is no valid depth in it.
    """
    inside = np.zeros(frame.depth.shape, dtype=bool)
    x0, y0 = int(np.floor(max(box.x, 0))), int(np.floor(max(box.y, 0)))
    x1, y1 = int(np.ceil(box.x + box.width)), int(np.ceil(box.y + box.height))
    inside[y0 : max(y1, 0), x0 : max(x1, 0)] = True
    if not inside.any():
        raise InputError(
            f"the box {box.x:g},{box.y:g},{box.width:g},{box.height:g} lies outside the "
            f"{frame.width}×{frame.height} image; it must read x,y,width,height in pixels"
        )
    inside &= valid_depth(frame)
    if not inside.any():
        raise InputError("there is no valid depth inside the box; start on another frame")
    plane = local_plane(frame, inside, seed, is_object=False)
    clear = inside
    if plane is not None:
        height = plane_height(frame, plane)
        clear = inside & (height > 0.004 + 2.0 * depth_noise(frame.depth))
    labels = connected_pieces(frame, clear, 0.02)
    counts = np.bincount(labels.ravel(), weights=_centre_weight(box, frame).ravel())
    counts[0] = 0
    if len(counts) < 2 or counts.max() <= 0:
        return Segment(inside, plane)
    return Segment(labels == int(np.argmax(counts)), plane)


def segment_click(
    frame: RgbdFrame, x: float, y: float, segmenter: Segmenter | None = None
) -> Segment:
    """The piece that was clicked on, or the one nearest to the click.

    Raises:
        InputError: the click lies outside the image, or nothing stands out near it.
    """
    if not (0 <= x < frame.width and 0 <= y < frame.height):
        raise InputError(
            f"the click {x:g},{y:g} lies outside the {frame.width}×{frame.height} image"
        )
    pieces = (segmenter or DepthClusters()).segment(frame)
    distances = [_distance_to(piece.mask, x, y) for piece in pieces]
    if not pieces or min(distances) > 0.05 * frame.width:
        raise InputError(
            f"nothing stands clear of its support at the click {x:g},{y:g}; give a mask or a box"
        )
    return pieces[int(np.argmin(distances))]


@dataclass(frozen=True, eq=False)
class LastPose:
    """What is where the object was last seen, or is predicted to be; see `propagated_mask`."""

    T_cam_obj: Float[np.ndarray, "4 4"]
    extents: Float[np.ndarray, "3"]
    plane_obj: Plane | None = None
    """That it stands on, in the object frame; what lies on it is left out."""

    def segment(self, frame: RgbdFrame) -> list[Segment]:
        """The mask, if anything is there."""
        mask = propagated_mask(frame, self.T_cam_obj, self.extents, self.plane_obj)
        return [Segment(mask)] if mask.any() else []


def propagated_mask(
    frame: RgbdFrame,
    T_cam_obj: Float[np.ndarray, "4 4"],
    extents: Float[np.ndarray, "3"],
    plane_obj: Plane | None = None,
    margin_m: float = 0.01,
) -> Bool[np.ndarray, "H W"]:
    """Pixels whose points lie in the box at a (predicted) pose and above its plane."""
    mask = np.zeros(frame.depth.shape, dtype=bool)
    rectangle = box_rectangle(frame, T_cam_obj, extents + 2 * margin_m)
    if rectangle is None:
        return mask
    x0, y0, x1, y1 = rectangle
    part = np.zeros_like(mask)
    part[y0:y1, x0:x1] = valid_depth(frame)[y0:y1, x0:x1]
    points_cam, pixels = backproject(frame.depth, frame.K, part)
    points = transform_points(invert_transform(T_cam_obj), points_cam)
    keep = (np.abs(points) < 0.5 * extents + margin_m).all(axis=-1)
    if plane_obj is not None:
        keep &= plane_obj.height(points) > 0.003 + 1.5 * depth_noise(points_cam[:, 2])
    x, y = pixels[keep].astype(int).T
    mask[y, x] = True
    return mask


def connected_pieces(
    frame: RgbdFrame, chosen: Bool[np.ndarray, "H W"], jump_m: float
) -> np.ndarray:
    """Label image [H, W] of the chosen pixels, cut at depth jumps; 0 elsewhere."""
    depth = np.where(chosen, frame.depth, 0.0).astype(np.float32)
    jump = jump_m + 4.0 * depth_noise(depth)
    cut = np.zeros(depth.shape, dtype=bool)
    for axis in (0, 1):
        step = np.abs(np.diff(depth, axis=axis))
        both = np.minimum(depth, np.roll(depth, -1, axis=axis)) > 0
        both = both[:-1] if axis == 0 else both[:, :-1]
        edge = both & (step > (jump[:-1] if axis == 0 else jump[:, :-1]))
        if axis == 0:
            cut[:-1] |= edge
        else:
            cut[:, :-1] |= edge
    _, labels = cv2.connectedComponents((chosen & ~cut).astype(np.uint8), connectivity=4)
    return labels


def _off_centre(mask: np.ndarray) -> float:
    y, x = np.nonzero(mask)
    return float(np.hypot(x.mean() - mask.shape[1] / 2, y.mean() - mask.shape[0] / 2))


def _distance_to(mask: np.ndarray, x: float, y: float) -> float:
    rows, columns = np.nonzero(mask)
    return float(np.hypot(columns - x, rows - y).min())


def _centre_weight(box: Box, frame: RgbdFrame) -> Float[np.ndarray, "H W"]:
    """1 at the box's centre, falling to 0.1 at its corners."""
    x = (np.arange(frame.width) - box.x - box.width / 2) / max(box.width / 2, 1.0)
    y = (np.arange(frame.height) - box.y - box.height / 2) / max(box.height / 2, 1.0)
    return np.clip(1.0 - 0.45 * (x**2 + (y**2)[:, None]), 0.1, 1.0)
