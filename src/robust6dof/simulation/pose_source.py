"""Where the servo's poses come from: a tracker that sees only images, or the truth to compare."""

from __future__ import annotations

from dataclasses import dataclass
from time import perf_counter
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from robust6dof.frames import PoseTracker, RgbdFrame, Track, TrackState
from robust6dof.simulation.eye_in_hand import Exposure


@dataclass(frozen=True, eq=False)
class PoseEstimate:
    """A pose and when it may be used."""

    T_cam_obj: Float[np.ndarray, "4 4"]
    extents: Float[np.ndarray, "3"]
    confidence: float
    state: TrackState
    stamp: float
    """When the image was taken [s]."""
    due: float
    """When the pose is ready [s]."""
    compute_ms: float
    """What the tracker took."""


@runtime_checkable
class PoseSource(Protocol):
    """Gives a pose for each image that it has time for."""

    def needs_image(self, time: float) -> bool:
        """Whether an image taken at `time` [s] would be looked at."""
        ...

    def estimate(
        self, time: float, exposure: Exposure | None, T_cam_obj: Float[np.ndarray, "4 4"]
    ) -> PoseEstimate | None:
        """The pose in the image taken at `time`; None while still busy with an earlier one."""
        ...


@dataclass(frozen=True, eq=False)
class TruePoses:
    """The truth, as late as a camera's image."""

    extents: Float[np.ndarray, "3"]
    latency: float

    def needs_image(self, time: float) -> bool:
        return False

    def estimate(
        self, time: float, exposure: Exposure | None, T_cam_obj: Float[np.ndarray, "4 4"]
    ) -> PoseEstimate:
        due = time + self.latency
        return PoseEstimate(T_cam_obj, self.extents, 1.0, TrackState.TRACKING, time, due, 0.0)


class TrackedPoses:
    """A tracker in the loop. The first image comes with a start hint, all others alone.

    Args:
        tracker: any.
        extents: the object's true size [m], part of the start hint.
        latency: from exposure to the image's arrival [s].
        measured: add the tracker's own computing time to the delay and skip the images that
            arrive meanwhile; otherwise a run repeats exactly.
    """

    def __init__(
        self,
        tracker: PoseTracker,
        extents: Float[np.ndarray, "3"],
        latency: float,
        measured: bool = False,
    ) -> None:
        self._tracker, self._extents = tracker, extents
        self._latency, self._measured = latency, measured
        self._track: Track | None = None
        self._free_at = -np.inf

    def needs_image(self, time: float) -> bool:
        return time + self._latency >= self._free_at

    def estimate(
        self, time: float, exposure: Exposure | None, T_cam_obj: Float[np.ndarray, "4 4"]
    ) -> PoseEstimate | None:
        if exposure is None or not self.needs_image(time):
            return None
        began = perf_counter()
        if self._track is None:
            self._track = self._start(exposure, T_cam_obj)
        else:
            self._track = self._follow(self._track, exposure.frame)
        seconds = perf_counter() - began
        self._free_at = time + self._latency + (seconds if self._measured else 0.0)
        track = self._track
        return PoseEstimate(
            track.T_cam_obj,
            track.extents,
            track.confidence,
            track.state,
            time,
            self._free_at,
            1e3 * seconds,
        )

    def _start(self, exposure: Exposure, T_cam_obj: Float[np.ndarray, "4 4"]) -> Track:
        return self._tracker.start(
            exposure.frame, mask=exposure.mask, T_cam_obj=T_cam_obj, extents=self._extents
        )

    def _follow(self, track: Track, frame: RgbdFrame) -> Track:
        return self._tracker.step(track, frame)
