"""The paper's own tracker: pose changes from matched keypoints, a memory, the canonical anchor."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import torch
from jaxtyping import Bool, Float

from robust6dof.frames import Box, RgbdFrame, Track, TrackState
from robust6dof.network.inputs import ViewFeatures
from robust6dof.tracking.confidence import (
    KEYPOINT_CONFIDENCE,
    ConfidenceModel,
    keypoint_evidence,
)
from robust6dof.tracking.encoder import ViewEncoder
from robust6dof.tracking.initialisation import find_initial_pose
from robust6dof.tracking.joint_pose import JointPose, JointPoseConfig, solve_joint_pose
from robust6dof.tracking.keyframes import Keyframe, KeyframeMemory
from robust6dof.tracking.motion import Motion, seconds_between
from robust6dof.tracking.states import StateCount, StateRules, next_state


@dataclass(frozen=True)
class KeypointConfig:
    """How the network is used."""

    pose: JointPoseConfig = field(default_factory=JointPoseConfig)
    confidence: ConfidenceModel = KEYPOINT_CONFIDENCE
    states: StateRules = field(default_factory=StateRules)
    start_passes: int = 2
    """Passes of the anchor over a first frame whose pose was estimated."""
    scale_gain: float = 0.05
    """Share of the anchor's scale that enters the track's extents on each frame."""
    store_confidence: float = 0.7
    """Views are stored from this confidence on."""
    memory_capacity: int = 12
    """Stored views at most; 0 matches the last frame alone."""


@dataclass(frozen=True, eq=False)
class KeypointMemory:
    """What the tracker carries from frame to frame."""

    last: Keyframe
    views: KeyframeMemory
    motion: Motion
    count: StateCount
    frames: int = 0


class KeypointTracker:
    """Keypoint matches behind the `PoseTracker` protocol, without surface registration.

    Args:
        encoder: the network and the category's prior.
        config: see its fields.
    """

    def __init__(self, encoder: ViewEncoder, config: KeypointConfig | None = None) -> None:
        self._encoder = encoder
        self.net = encoder.net
        self.category = encoder.category
        self.config = config or KeypointConfig()

    def start(
        self,
        frame: RgbdFrame,
        *,
        mask: Bool[np.ndarray, "H W"] | None = None,
        box: Box | None = None,
        T_cam_obj: Float[np.ndarray, "4 4"] | None = None,
        extents: Float[np.ndarray, "3"] | None = None,
    ) -> Track:
        """Begin from a pose, a mask, a box, or by itself; see `find_initial_pose`.

        A given pose is kept; an estimated one is improved by the canonical anchor.
        """
        initial = find_initial_pose(
            frame, self.category, mask=mask, box=box, T_cam_obj=T_cam_obj, extents=extents
        )
        passes = self.config.start_passes if T_cam_obj is None else 0
        T_start, extents = initial.T_cam_obj, initial.extents
        features, estimate = self._look(frame, T_start, extents, 0)
        for number in range(1, passes + 1):
            T_start = estimate.T_cam_obj
            extents = extents * estimate.anchor.scale / np.linalg.norm(extents)
            features, estimate = self._look(frame, T_start, extents, number)
        confidence = self.config.confidence(keypoint_evidence(estimate))
        first = Keyframe(features, T_start, confidence)
        memory = KeypointMemory(
            last=first,
            views=KeyframeMemory((first,), self.config.memory_capacity),
            motion=Motion.at_rest(),
            count=StateCount(),
        )
        return Track(
            T_cam_obj=T_start,
            extents=extents,
            confidence=confidence,
            state=TrackState.TRACKING,
            category=self.category,
            stamp=frame.stamp,
            memory=memory,
        )

    def _look(
        self, frame: RgbdFrame, T_cam_obj: np.ndarray, extents: np.ndarray, number: int
    ) -> tuple[ViewFeatures, JointPose]:
        """One view alone: the anchor's estimate near a given pose."""
        features = self._encoder.first(frame, T_cam_obj, extents, number)
        alone = replace(self.config.pose, anchor_weight=1.0)
        return features, self._solve(features, (), T_cam_obj, extents, number, frame.K, alone)

    def step(self, track: Track, frame: RgbdFrame) -> Track:
        """Follow the object to `frame`; never raises on a bad image."""
        memory: KeypointMemory = track.memory
        seconds = seconds_between(track.stamp, frame.stamp)
        T_cam_pred = memory.motion.predict(track.T_cam_obj, seconds)
        number = memory.frames + 1
        features = self._encoder.encode(
            frame, T_cam_pred, track.extents, memory.last.features, number
        )
        if features is None:
            return self._unseen(track, frame)
        stored = memory.views.nearest(T_cam_pred, self.config.pose.stored_views)
        past = [memory.last, *stored] if self.config.memory_capacity else [memory.last]
        estimate = self._solve(features, past, T_cam_pred, track.extents, number, frame.K)
        return self._followed(track, frame, features, estimate, seconds)

    def _followed(
        self,
        track: Track,
        frame: RgbdFrame,
        features: ViewFeatures,
        estimate: JointPose,
        seconds: float,
    ) -> Track:
        memory: KeypointMemory = track.memory
        confidence = self.config.confidence(keypoint_evidence(estimate))
        count = memory.count.after(confidence, self.config.states)
        view = Keyframe(features, estimate.T_cam_obj, confidence)
        newest = Motion.between(track.T_cam_obj, estimate.T_cam_obj, seconds)
        trusted = confidence >= self.config.store_confidence
        memory = replace(
            memory,
            last=view,
            views=memory.views.with_view(view) if trusted else memory.views,
            motion=memory.motion.blended(newest, 0.6) if count.good else Motion.at_rest(),
            count=count,
            frames=memory.frames + 1,
        )
        growth = (estimate.anchor.scale / track.scale) ** (self.config.scale_gain * trusted)
        return replace(
            track,
            T_cam_obj=estimate.T_cam_obj,
            extents=track.extents * growth,
            confidence=confidence,
            state=next_state(track.state, count, self.config.states),
            stamp=frame.stamp,
            memory=memory,
        )

    def _unseen(self, track: Track, frame: RgbdFrame) -> Track:
        """No depth where the object should be: hold the last pose."""
        memory: KeypointMemory = track.memory
        count = memory.count.after(0.0, self.config.states)
        memory = replace(memory, count=count, motion=Motion.at_rest(), frames=memory.frames + 1)
        return replace(
            track,
            confidence=0.0,
            state=next_state(track.state, count, self.config.states),
            stamp=frame.stamp,
            memory=memory,
        )

    @torch.inference_mode()
    def _solve(
        self,
        features: ViewFeatures,
        past: list[Keyframe] | tuple[()],
        T_cam_pred: np.ndarray,
        extents: np.ndarray,
        number: int,
        K: np.ndarray,
        weights: JointPoseConfig | None = None,
    ) -> JointPose:
        rng = np.random.default_rng([self._encoder.seed, number, 1])
        return solve_joint_pose(
            self.net,
            features,
            past,
            T_cam_pred,
            float(np.linalg.norm(extents)),
            self._encoder.symmetric,
            K,
            weights or self.config.pose,
            rng,
        )
