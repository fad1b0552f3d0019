"""What of a frame may be the object at a predicted pose."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int

from robust6dof.frames import RgbdFrame
from robust6dof.geometry.transforms import invert_transform, transform_points
from robust6dof.tracking.region import cut_region, depth_noise
from robust6dof.tracking.support_plane import Plane
from robust6dof.tracking.surface.cloud import Cloud, surface_cloud


@dataclass(frozen=True)
class CutConfig:
    """How much of a frame is used."""

    max_pixels: int = 6000
    """Pixels of the rectangle around the box that are looked at."""
    max_points: int = 450
    """Object points that are kept."""


def cut_frame(
    frame: RgbdFrame,
    T_cam_obj: Float[np.ndarray, "4 4"],
    extents: Float[np.ndarray, "3"],
    plane: Plane | None,
    *,
    margin: float,
    voxel: float,
    config: CutConfig,
    mask: Bool[np.ndarray, "H W"] | None = None,
) -> Cloud:
    """Points inside the box grown by `margin` [m] and above the plane; empty when out of view.

    Args:
        plane: in the object frame, where the object stands on one.
        voxel: the points are thinned to one in each voxel of this side [m].
        mask: the object's pixels, where they are given (the first frame).
    """
    region = cut_region(frame, T_cam_obj, extents + 2.0 * margin, max_points=config.max_pixels)
    if region is None:
        return Cloud.empty()
    T_obj_cam = invert_transform(T_cam_obj)
    points = transform_points(T_obj_cam, region.points_cam)
    inside = (np.abs(points) < 0.5 * extents + margin).all(axis=-1)
    if plane is not None:
        inside &= plane.height(points) > 0.003 + 1.5 * float(depth_noise(T_cam_obj[2, 3]))
    if mask is not None:
        inside &= mask[region.pixels[:, 1], region.pixels[:, 0]]
    return surface_cloud(
        points[inside],
        colors_at(frame, region.pixels[inside], T_cam_obj[2, 3], voxel),
        voxel=voxel,
        viewpoint=T_obj_cam[:3, 3],
        max_points=config.max_points,
    )


def colors_at(
    frame: RgbdFrame, pixels: Int[np.ndarray, "P 2"], distance: float, detail_m: float
) -> Float[np.ndarray, "P 3"]:
    """Colours at pixels (x, y), blurred to a detail at a distance [m]; NaN without colour."""
    if not (frame.has_color and len(pixels)):
        return np.full((len(pixels), 3), np.nan)
    (x0, y0), (x1, y1) = pixels.min(axis=0), pixels.max(axis=0) + 1
    side = int(np.clip(detail_m * frame.K[0, 0] / distance, 1, 25))
    blurred = cv2.blur(frame.rgb[y0:y1, x0:x1], (side, side))
    return blurred[pixels[:, 1] - y0, pixels[:, 0] - x0].astype(np.float64)
