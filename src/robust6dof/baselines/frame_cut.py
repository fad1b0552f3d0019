"""What of a frame may be the object at a predicted pose, and what the plane that it stands on."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float

from robust6dof.baselines.cloud import Cloud, surface_cloud
from robust6dof.baselines.registration_target import plane_radius
from robust6dof.frames import RgbdFrame
from robust6dof.geometry.transforms import invert_transform, transform_points
from robust6dof.tracking.region import Region, cut_region, depth_noise
from robust6dof.tracking.support_plane import Plane


@dataclass(frozen=True)
class CutConfig:
    """How much of a frame is used."""

    max_pixels: int = 6000
    """Pixels of the rectangle around the box that are looked at."""
    max_points: int = 600
    """Object points that are kept."""
    max_plane_points: int = 200
    use_color: bool = True


@dataclass(frozen=True, eq=False)
class FrameCut:
    """One frame's points in the predicted object frame."""

    surface: Cloud
    plane_points: Float[np.ndarray, "R 3"]
    """[m]"""

    def joined(self, plane: Plane | None) -> Cloud:
        """Object and plane as one cloud to register."""
        if plane is None or not len(self.plane_points):
            return self.surface
        count = len(self.plane_points)
        normals = np.tile(plane.normal, (count, 1))
        return self.surface.joined(Cloud(self.plane_points, normals, np.full(count, np.nan)))


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
) -> FrameCut | None:
    """Points inside the box grown by `margin` [m] and above the plane; None when out of view.

    Args:
        plane: in the object frame, where the object stands on one.
        voxel: the points are thinned to one in each voxel of this side [m].
        mask: the object's pixels, where they are given (the first frame).
    """
    around = extents + 2.0 * margin
    if plane is not None:
        around = np.maximum(around, 2.0 * plane_radius(extents))
    region = cut_region(frame, T_cam_obj, around, max_points=config.max_pixels)
    if region is None:
        return None
    T_obj_cam = invert_transform(T_cam_obj)
    points = transform_points(T_obj_cam, region.points_cam)
    inside = (np.abs(points) < 0.5 * extents + margin).all(axis=-1)
    plane_points = np.zeros((0, 3))
    if plane is not None:
        on_plane, above = _split_by_plane(points, plane, extents, T_cam_obj[2, 3])
        plane_points = _thinned(points[on_plane & ~inside], config.max_plane_points)
        inside &= above
    if mask is not None:
        inside &= mask[region.pixels[:, 1], region.pixels[:, 0]]
    surface = surface_cloud(
        points[inside],
        _intensity(frame, region, np.asarray(inside), T_cam_obj[2, 3], voxel, config),
        voxel=voxel,
        viewpoint=T_obj_cam[:3, 3],
        max_points=config.max_points,
    )
    return FrameCut(surface, plane_points)


def _split_by_plane(
    points: np.ndarray, plane: Plane, extents: np.ndarray, distance: float
) -> tuple[Bool[np.ndarray, "P"], Bool[np.ndarray, "P"]]:
    """Which points are the plane's near the object, and which stand clear of it."""
    height = plane.height(points)
    noise = float(depth_noise(distance))
    near = np.einsum("pc,pc->p", points, points) < plane_radius(extents) ** 2
    return near & (np.abs(height) < 0.02 + 2.0 * noise), height > 0.003 + 1.5 * noise


def _intensity(
    frame: RgbdFrame,
    region: Region,
    chosen: Bool[np.ndarray, "P"],
    distance: float,
    voxel: float,
    config: CutConfig,
) -> Float[np.ndarray, "Q"]:
    """Grey levels, blurred to the model's resolution; NaN without colour."""
    if not (config.use_color and frame.has_color and chosen.any()):
        return np.full(int(chosen.sum()), np.nan)
    pixels = region.pixels[chosen]
    (x0, y0), (x1, y1) = pixels.min(axis=0), pixels.max(axis=0) + 1
    grey = cv2.cvtColor(frame.rgb[y0:y1, x0:x1], cv2.COLOR_RGB2GRAY)
    sigma = float(np.clip(0.4 * voxel * frame.K[0, 0] / distance, 0.5, 8.0))
    blurred = cv2.GaussianBlur(grey, (0, 0), sigma)
    return blurred[pixels[:, 1] - y0, pixels[:, 0] - x0].astype(np.float64)


def _thinned(points: np.ndarray, count: int) -> np.ndarray:
    return points[:: max(1, int(np.ceil(len(points) / count)))]
