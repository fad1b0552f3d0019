"""What the feature tracker carries from frame to frame: the last view and some stored ones."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from robust6dof.geometry.transforms import invert_transform, view_direction
from robust6dof.tracking.image_features import Features
from robust6dof.tracking.motion import Motion
from robust6dof.tracking.states import StateCount
from robust6dof.tracking.support_plane import Plane
from robust6dof.tracking.surface.cloud import Cloud
from robust6dof.tracking.surface.registration_target import RegistrationTarget

LEARNING_MARGIN = 0.02
"""How far outside the box a view's points are remembered, as a share of its diagonal."""


@dataclass(frozen=True, eq=False)
class StoredView:
    """A past frame's features and surface, in the object frame."""

    features: Features
    surface: RegistrationTarget
    T_cam_obj: Float[np.ndarray, "4 4"]

    @property
    def direction(self) -> Float[np.ndarray, "3"]:
        """Unit vector from the object to the camera, in the object frame."""
        return view_direction(self.T_cam_obj)


@dataclass(frozen=True, eq=False)
class FeatureMemory:
    """Immutable; each step makes a new one."""

    last: StoredView
    views: tuple[StoredView, ...]
    plane: Plane | None
    """What the object stood on in the first frame, in the object frame."""
    motion: Motion
    count: StateCount
    frames: int = 0

    def nearest(self, T_cam_obj: np.ndarray, count: int) -> list[StoredView]:
        """The last frame, then the stored views seen from nearest to here."""
        here = view_direction(T_cam_obj)
        ranked = sorted(self.views, key=lambda view: -float(view.direction @ here))
        return [self.last, *ranked[:count]]

    def with_view(self, view: StoredView, spacing: float, capacity: int) -> FeatureMemory:
        """Take a view in where none stands within `spacing` [rad]; the oldest but one goes."""
        cosines = [float(view.direction @ old.direction) for old in self.views]
        if max(cosines) > np.cos(spacing):
            return self
        views = (*self.views, view)
        kept = views if len(views) <= capacity else (views[0], *views[2:])
        return replace(self, views=kept)


def store_view(
    features: Features, cloud: Cloud, T_cam_obj: np.ndarray, extents: np.ndarray
) -> StoredView:
    """What lies in the box, of features in the camera's frame and a cloud in the object's."""
    moved = features.moved(invert_transform(T_cam_obj))
    reach = 0.5 * extents + LEARNING_MARGIN * float(np.linalg.norm(extents))
    moved = moved[_inside(moved.points, reach)]
    cloud = cloud[_inside(cloud.points, reach)]
    return StoredView(moved, RegistrationTarget.build(cloud), T_cam_obj)


def _inside(points: np.ndarray, reach: np.ndarray) -> Bool[np.ndarray, "P"]:
    return np.asarray((np.abs(points) < reach).all(axis=-1))
