"""A tracker that never moves: the error of doing nothing, and the least a protocol must tell."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float

from robust6dof.frames import Box, RgbdFrame, Track, TrackState
from robust6dof.tracking.initialisation import find_initial_pose


class StaticTracker:
    """Keeps the first pose; after the first frame with confidence 0 and state UNCERTAIN."""

    def __init__(self, category: str = "object") -> None:
        self.category = category

    def start(
        self,
        frame: RgbdFrame,
        *,
        mask: Bool[np.ndarray, "H W"] | None = None,
        box: Box | None = None,
        T_cam_obj: Float[np.ndarray, "4 4"] | None = None,
        extents: Float[np.ndarray, "3"] | None = None,
    ) -> Track:
        """Begin as every tracker does; see `find_initial_pose`."""
        initial = find_initial_pose(
            frame, self.category, mask=mask, box=box, T_cam_obj=T_cam_obj, extents=extents
        )
        return Track(
            T_cam_obj=initial.T_cam_obj,
            extents=initial.extents,
            confidence=1.0,
            state=TrackState.TRACKING,
            category=self.category,
            stamp=frame.stamp,
        )

    def step(self, track: Track, frame: RgbdFrame) -> Track:
        """The same pose."""
        return replace(track, confidence=0.0, state=TrackState.UNCERTAIN, stamp=frame.stamp)
