"""A bounded memory of past views: what keeps chained pose changes from drifting."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from robust6dof.geometry.transforms import rotation_error, view_direction
from robust6dof.network.inputs import ViewFeatures


@dataclass(frozen=True, eq=False)
class Keyframe:
    """A past view and where the object was in it."""

    features: ViewFeatures
    """Batch of one."""
    T_cam_obj: Float[np.ndarray, "4 4"]
    confidence: float

    @property
    def view_direction(self) -> Float[np.ndarray, "3"]:
        """Unit vector from the object to the camera, in the object frame."""
        return view_direction(self.T_cam_obj)


@dataclass(frozen=True, eq=False)
class KeyframeMemory:
    """Keyframes spread over the viewpoints seen; the first view always stays."""

    keyframes: tuple[Keyframe, ...] = ()
    capacity: int = 12
    """Most keyframes kept."""
    spacing: float = np.deg2rad(12.0)
    """Least angle between the view directions of two keyframes [rad]."""

    def nearest(self, T_cam_obj: Float[np.ndarray, "4 4"], count: int) -> Sequence[Keyframe]:
        """The `count` keyframes whose orientation is nearest to this one's."""
        ranked = sorted(self.keyframes, key=lambda k: _angle(k.T_cam_obj, T_cam_obj))
        return ranked[:count]

    def with_view(self, new: Keyframe) -> KeyframeMemory:
        """The memory with a view taken in, where it adds a viewpoint or is better than its like.

        Over capacity, the one of the two closest keyframes with less confidence goes.
        """
        near = [i for i, k in enumerate(self.keyframes) if self._is_near(k, new)]
        if self.capacity < 2 or any(
            self.keyframes[i].confidence >= new.confidence - 0.05 or i == 0 for i in near
        ):
            return self
        kept = [k for i, k in enumerate(self.keyframes) if i not in near] + [new]
        while len(kept) > self.capacity:
            kept.pop(_most_redundant(kept))
        return KeyframeMemory(tuple(kept), self.capacity, self.spacing)

    def _is_near(self, old: Keyframe, new: Keyframe) -> bool:
        cosine = float(old.view_direction @ new.view_direction)
        return bool(cosine > np.cos(self.spacing))


def _angle(T_a: np.ndarray, T_b: np.ndarray) -> float:
    return float(rotation_error(T_a[:3, :3], T_b[:3, :3]))


def _most_redundant(keyframes: list[Keyframe]) -> int:
    """Index of the less trusted of the two closest keyframes; never the first."""
    directions = np.stack([k.view_direction for k in keyframes])
    cosines = directions @ directions.T
    np.fill_diagonal(cosines, -1.0)
    i, j = np.unravel_index(int(np.argmax(cosines)), cosines.shape)
    candidates = [int(k) for k in (i, j) if k != 0]
    return min(candidates, key=lambda k: keyframes[k].confidence)
