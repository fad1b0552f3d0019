"""What surrounds the object: while it stands still among it, both move as one.

The surroundings show turns that the object itself hides (a cup about its axis) and fix what its
own few points leave in doubt. They have a model of their own beside the object's.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from robust6dof.frames import RgbdFrame
from robust6dof.geometry.transforms import invert_transform, transform_points
from robust6dof.tracking.region import cut_region
from robust6dof.tracking.surface.cloud import Cloud, surface_cloud
from robust6dof.tracking.surface.frame_cut import colors_at
from robust6dof.tracking.surface.registration_target import RegistrationTarget
from robust6dof.tracking.surface.surface_model import SurfaceModel


@dataclass(frozen=True)
class SurroundingsConfig:
    """Sizes of the surroundings' model."""

    reach_share: float = 1.0
    """Radius of the sphere around the object, as a share of its diagonal, …"""
    reach_m: float = 0.35
    """… and this more."""
    voxel_m: float = 0.016
    max_points: int = 300
    """Points of one frame."""
    max_model_points: int = 4000
    least_points: int = 60
    """With fewer there is nothing to go by."""


@dataclass(frozen=True, eq=False)
class Surroundings:
    """Their surface in the object frame. Immutable."""

    surface: SurfaceModel
    target: RegistrationTarget
    config: SurroundingsConfig

    @classmethod
    def seen_in(
        cls,
        frame: RgbdFrame,
        T_cam_obj: Float[np.ndarray, "4 4"],
        extents: Float[np.ndarray, "3"],
        config: SurroundingsConfig,
    ) -> Surroundings | None:
        """Begin a model; None where there is too little around the object."""
        view = _cut(frame, T_cam_obj, extents, config)
        if len(view) < config.least_points:
            return None
        surface = SurfaceModel.empty(config.voxel_m, config.max_model_points).merged(view, 1.0)
        return cls(surface, RegistrationTarget.build(surface.cloud), config)

    def with_view(self, view: Cloud) -> Surroundings:
        """Take in a view."""
        surface = self.surface.merged(view, 1.0)
        return replace(self, surface=surface, target=RegistrationTarget.build(surface.cloud))

    def cut(
        self,
        frame: RgbdFrame,
        T_cam_obj: Float[np.ndarray, "4 4"],
        extents: Float[np.ndarray, "3"],
    ) -> Cloud:
        """What of the frame lies around the object but outside its box, in the object frame."""
        return _cut(frame, T_cam_obj, extents, self.config)


def _cut(
    frame: RgbdFrame, T_cam_obj: np.ndarray, extents: np.ndarray, config: SurroundingsConfig
) -> Cloud:
    radius = config.reach_share * float(np.linalg.norm(extents)) + config.reach_m
    region = cut_region(frame, T_cam_obj, np.full(3, 2.0 * radius), max_points=3000)
    if region is None:
        return Cloud.empty()
    T_obj_cam = invert_transform(T_cam_obj)
    points = transform_points(T_obj_cam, region.points_cam)
    chosen = np.einsum("pc,pc->p", points, points) < radius**2
    chosen &= (np.abs(points) > 0.55 * extents + 0.005).any(axis=-1)
    return surface_cloud(
        points[chosen],
        colors_at(frame, region.pixels[chosen], T_cam_obj[2, 3], config.voxel_m),
        voxel=config.voxel_m,
        viewpoint=T_obj_cam[:3, 3],
        max_points=config.max_points,
    )
