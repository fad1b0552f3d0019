"""What the tracker carries from frame to frame."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from robust6dof.frames import RgbdFrame, Track
from robust6dof.geometry.transforms import invert_transform, transform_points
from robust6dof.tracking.canonical_frame import CanonicalFrame
from robust6dof.tracking.keyframes import Keyframe, KeyframeMemory
from robust6dof.tracking.motion import Motion
from robust6dof.tracking.place import PlaceConfig, PlaceMemory
from robust6dof.tracking.states import StateCount
from robust6dof.tracking.surface.icp_memory import assess_surface

_IN_VIEW, _SEEN_THROUGH = 0.7, 0.5
"""Its place is in view without it where more of the object's surface than the first is in the
image, and the depth image sees through more than the second of it."""


@dataclass(frozen=True, eq=False)
class TrackerMemory:
    """Immutable; each step makes a new one."""

    surface: Track
    """The registration's own track: its object frame is the model frame."""
    canonical: CanonicalFrame
    shape: Float[np.ndarray, "3"]
    """Extents over their diagonal."""
    last: Keyframe
    views: KeyframeMemory
    evidence: Float[np.ndarray, "3"] | None
    """Of the last look; None where there was nothing to look at."""
    T_model_given: Float[np.ndarray, "4 4"] | None
    """The object frame as it was given; None where the start was estimated."""
    place: PlaceMemory
    """Of the registration's model frame."""
    likeness: float = 1.0
    """Of the surface and the category, at the last look: see `CategoryShape`. 1 while the object
    frame is about where it was given."""
    count: StateCount = field(default_factory=StateCount)
    stands: bool = False
    """What was found again is where the lost object stood, as far as that could be told."""
    seconds: float = 0.0
    """Since the start."""
    frames: int = 0

    @property
    def extents(self) -> Float[np.ndarray, "3"]:
        """Of the object's box, as believed now [m]."""
        return self.shape * self.canonical.scale

    @property
    def seen_points(self) -> Float[np.ndarray, "P 3"]:
        """Of the surface as seen so far, in the object frame [m]."""
        T_obj_model = invert_transform(self.canonical.T_model_obj)
        return transform_points(T_obj_model, self.surface.memory.surface.cloud.points)

    def T_cam_obj(self, surface: Track) -> Float[np.ndarray, "4 4"]:
        """The object where the registration puts its surface."""
        return surface.T_cam_obj @ self.canonical.T_model_obj

    def T_cam_model(self, T_cam_obj: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "4 4"]:
        """The registration's surface where the object is here."""
        return T_cam_obj @ invert_transform(self.canonical.T_model_obj)

    def following_place(
        self, frame: RgbdFrame, seconds: float, config: PlaceConfig, lost: bool
    ) -> TrackerMemory:
        """The object is in doubt; where it is lost, it stays in its place, if that is known, and
        for how long that was in view without it is counted."""
        place = self.place.after_loss(frame, seconds, config)
        if not lost or place.T_cam_obj is None:
            return replace(self, place=place)
        surface = self.surface_at(place.T_cam_obj)
        seen, _ = assess_surface(frame, place.T_cam_obj, surface.memory.surface)
        if seen.in_image > _IN_VIEW and seen.contradicted > _SEEN_THROUGH:
            place = place.in_view_without(seconds, config)
        return replace(self, place=place, surface=surface)

    def surface_at(self, T_cam_model: Float[np.ndarray, "4 4"]) -> Track:
        """The registration's track with its surface here and at rest."""
        rested = replace(self.surface.memory, motion=Motion.at_rest())
        return replace(self.surface, T_cam_obj=T_cam_model, memory=rested)
