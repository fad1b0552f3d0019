"""Robust6DoF as a tracker: the network says what and where, registration follows the surface.

Each frame:

1. The surface seen so far is registered to the frame, from the motion's prediction.
2. Where that fails, the network's keypoint matches with past views say where to try again; once
   the object is lost, it is looked for in the whole image.
3. The frame's canonical anchor is one more opinion of where the object's frame lies on that
   surface (see `canonical_frame`): so a rough start is corrected and a slip does not stay.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Bool, Float

from robust6dof.frames import Box, RgbdFrame, Track, TrackState
from robust6dof.geometry.transforms import invert_transform
from robust6dof.network.inputs import ViewFeatures
from robust6dof.solver.absolute import AbsoluteFit
from robust6dof.tracking.canonical_frame import (
    ESTIMATED_START,
    ROUGH_START,
    CanonicalFrame,
    CanonicalFrameConfig,
    Doubt,
)
from robust6dof.tracking.confidence import TRACK_CONFIDENCE, ConfidenceModel, track_evidence
from robust6dof.tracking.encoder import ViewEncoder
from robust6dof.tracking.first_look import FirstLookConfig, look_around
from robust6dof.tracking.initialisation import find_initial_pose
from robust6dof.tracking.joint_pose import JointPoseConfig, solve_joint_pose
from robust6dof.tracking.keyframes import Keyframe, KeyframeMemory
from robust6dof.tracking.motion import Motion, seconds_between
from robust6dof.tracking.recovery import (
    RecoveryConfig,
    confirmed_poses,
    is_same_pose,
    poses_to_try,
)
from robust6dof.tracking.states import StateCount, StateRules, next_state
from robust6dof.tracking.surface.icp import IcpTracker
from robust6dof.tracking.surface.icp_config import IcpConfig


@dataclass(frozen=True)
class TrackerConfig:
    """How network and registration work together."""

    surface: IcpConfig = field(default_factory=IcpConfig)
    canonical: CanonicalFrameConfig = field(default_factory=CanonicalFrameConfig)
    pose: JointPoseConfig = field(default_factory=JointPoseConfig)
    """Of the poses that the network alone proposes."""
    confidence: ConfidenceModel = TRACK_CONFIDENCE
    states: StateRules = field(default_factory=StateRules)
    given_doubt: Doubt = ROUGH_START
    """In a start pose that was given; `EXACT_START` where it is known to be true."""
    estimated_doubt: Doubt = ESTIMATED_START
    """In one that was estimated from a mask, a box or nothing."""
    first_look: FirstLookConfig = field(default_factory=FirstLookConfig)
    look_every: int = 2
    """Frames from one look of the network to the next while all goes well; registration learns on
    the others, so that no frame pays for both."""
    surface_trust: float = 0.5
    """Confidence of the registration from which a look is believed to be placed rightly."""
    anchor_trust: float = 0.35
    """Least share of points that must agree with a look's own pose."""
    recovery: RecoveryConfig = field(default_factory=RecoveryConfig)
    memory_capacity: int = 12
    """Views kept to be matched."""


@dataclass(frozen=True, eq=False)
class TrackerMemory:
    """What the tracker carries from frame to frame."""

    surface: Track
    """The registration's own track: its object frame is the model frame."""
    canonical: CanonicalFrame
    shape: Float[np.ndarray, "3"]
    """Extents over their diagonal."""
    last: Keyframe
    views: KeyframeMemory
    evidence: Float[np.ndarray, "6"]
    """Of the last look; zeros where there was nothing to look at."""
    count: StateCount = field(default_factory=StateCount)
    seconds: float = 0.0
    """Since the start."""
    frames: int = 0


class Tracker:
    """The network's tracker behind the `PoseTracker` protocol.

    Args:
        encoder: the network and the category's prior.
        config: see its fields.
    """

    def __init__(self, encoder: ViewEncoder, config: TrackerConfig | None = None) -> None:
        self._encoder = encoder
        self.net = encoder.net
        self.category = encoder.category
        self.config = config or TrackerConfig()
        self._surface = IcpTracker(self.category, self.config.surface, seed=encoder.seed)

    @classmethod
    def from_pretrained(
        cls,
        path: str | Path | None = None,
        *,
        category: str,
        config: TrackerConfig | None = None,
        device: str = "auto",
        seed: int = 0,
    ) -> Tracker:
        """A tracker with the shipped weights, or with one's own.

        Args:
            path: weights that `robust6dof train` wrote; the shipped ones if not given.
            category: one with a shipped prior.
            config: see its fields.
            device: auto, cpu or cuda.
            seed: of the points drawn and of RANSAC.

        Raises:
            DataError: unusable weights.
            InputError: no prior for the category.
        """
        return cls(ViewEncoder.from_pretrained(path, category, device, seed), config)

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

        The pose is corrected by the anchor at once, as far as it is in doubt.

        Raises:
            InputError: no depth on the object, or no object found.
        """
        initial = find_initial_pose(
            frame, self.category, mask=mask, box=box, T_cam_obj=T_cam_obj, extents=extents
        )
        doubt = self.config.given_doubt if T_cam_obj is not None else self.config.estimated_doubt
        scale = float(np.linalg.norm(initial.extents))
        shape = initial.extents / scale
        canonical = CanonicalFrame.at_start(scale, doubt, self.config.canonical)
        anchor = look_around(self._encoder, frame, initial, doubt, self.config.first_look)
        if anchor.inlier_share >= self.config.anchor_trust:
            canonical = self._with_look(canonical, initial.T_cam_obj, anchor, 0.0)
        T_cam_obj = initial.T_cam_obj @ canonical.T_model_obj
        canonical = canonical.rebased()
        extents = shape * canonical.scale
        surface = self._surface.start(frame, T_cam_obj=T_cam_obj, extents=extents)
        features = self._encoder.first(frame, T_cam_obj, extents)
        evidence = self._evidence(
            features, self._encoder.anchor(features, 0), surface, T_cam_obj, canonical.scale
        )
        confidence = self.config.confidence(evidence)
        first = Keyframe(features, T_cam_obj, confidence)
        views = KeyframeMemory((first,), self.config.memory_capacity)
        return Track(
            T_cam_obj=T_cam_obj,
            extents=extents,
            confidence=confidence,
            state=TrackState.TRACKING,
            category=self.category,
            stamp=frame.stamp,
            memory=TrackerMemory(surface, canonical, shape, first, views, evidence),
        )

    def step(self, track: Track, frame: RgbdFrame) -> Track:
        """Follow the object to `frame`; never raises on a bad image."""
        memory: TrackerMemory = track.memory
        seconds = seconds_between(track.stamp, frame.stamp)
        memory = replace(memory, seconds=memory.seconds + seconds, frames=memory.frames + 1)
        due = memory.frames % self.config.look_every == 0 or track.state is not TrackState.TRACKING
        learn = self.config.look_every == 1 or not due
        surface = self._surface.step(memory.surface, frame, learn=learn)
        if not due and surface.confidence >= self.config.surface_trust:
            return self._updated(track, frame, replace(memory, surface=surface), None)
        return self._looked(track, frame, surface, memory)

    def _looked(
        self, track: Track, frame: RgbdFrame, surface: Track, memory: TrackerMemory
    ) -> Track:
        """The registration's track after the network's look at the frame."""
        features = self._encode(frame, surface.T_cam_obj, memory)
        if surface.confidence < self.config.surface_trust:
            surface = self._tried_again(frame, surface, features, memory, track.state)
            features = self._encode(frame, surface.T_cam_obj, memory)
        if features is None:
            unseen = replace(memory, surface=surface, evidence=np.zeros(6))
            return self._updated(track, frame, unseen, None)
        anchor = self._encoder.anchor(features, memory.frames)
        memory = replace(memory, surface=surface)
        placed = surface.confidence >= self.config.surface_trust
        if placed and anchor.inlier_share >= self.config.anchor_trust:
            canonical = self._with_look(memory.canonical, surface.T_cam_obj, anchor, memory.seconds)
            memory = replace(memory, canonical=canonical)
        T_cam_obj = surface.T_cam_obj @ memory.canonical.T_model_obj
        evidence = self._evidence(features, anchor, surface, T_cam_obj, memory.canonical.scale)
        return self._updated(track, frame, replace(memory, evidence=evidence), features)

    def _encode(
        self, frame: RgbdFrame, T_cam_model: np.ndarray, memory: TrackerMemory
    ) -> ViewFeatures | None:
        T_cam_pred = T_cam_model @ memory.canonical.T_model_obj
        extents = memory.shape * memory.canonical.scale
        return self._encoder.encode(frame, T_cam_pred, extents, memory.last.features, memory.frames)

    def _tried_again(
        self,
        frame: RgbdFrame,
        surface: Track,
        features: ViewFeatures | None,
        memory: TrackerMemory,
        state: TrackState,
    ) -> Track:
        """Registration from where the network puts the object, if that fits better: by its matches
        with past views; once the object is lost, by looking at all that could be it."""
        T_cam_pred = surface.T_cam_obj @ memory.canonical.T_model_obj
        proposals = []
        if features is not None:
            proposals.append(self._matched(frame, T_cam_pred, features, memory))
        if state is TrackState.LOST:
            scale, recovery = memory.canonical.scale, self.config.recovery
            guesses = poses_to_try(frame, T_cam_pred, scale, self._encoder.symmetric, recovery)
            extents = memory.shape * scale
            proposals += confirmed_poses(
                self._encoder, frame, guesses, extents, memory.frames, recovery
            )
        tried = [self._registered_from(T, frame, memory) for T in proposals]
        believed = [one for one in tried if self._is_confirmed(frame, one, memory)]
        return max([surface, *believed], key=lambda one: one.confidence)

    def _is_confirmed(self, frame: RgbdFrame, surface: Track, memory: TrackerMemory) -> bool:
        """Whether the network, looking there, sees the object as it is registered."""
        if surface.confidence < self.config.surface_trust:
            return False
        features = self._encode(frame, surface.T_cam_obj, memory)
        if features is None:
            return False
        anchor = self._encoder.anchor(features, memory.frames)
        T_cam_obj = surface.T_cam_obj @ memory.canonical.T_model_obj
        return is_same_pose(anchor, T_cam_obj, memory.canonical.scale, self._encoder.symmetric)

    @torch.inference_mode()
    def _matched(
        self,
        frame: RgbdFrame,
        T_cam_pred: np.ndarray,
        features: ViewFeatures,
        memory: TrackerMemory,
    ) -> np.ndarray:
        """T_cam_obj from the keypoint matches with the last and the nearest stored views."""
        past = [memory.last, *memory.views.nearest(T_cam_pred, self.config.pose.stored_views)]
        return solve_joint_pose(
            self.net,
            features,
            past,
            T_cam_pred,
            memory.canonical.scale,
            self._encoder.symmetric,
            frame.K,
            self.config.pose,
            np.random.default_rng([self._encoder.seed, memory.frames, 1]),
        ).T_cam_obj

    def _registered_from(
        self, T_cam_obj: np.ndarray, frame: RgbdFrame, memory: TrackerMemory
    ) -> Track:
        """Registration that begins with the object here and at rest."""
        T_cam_model = T_cam_obj @ invert_transform(memory.canonical.T_model_obj)
        rested = replace(memory.surface.memory, motion=Motion.at_rest())
        return self._surface.step(
            replace(memory.surface, T_cam_obj=T_cam_model, memory=rested), frame
        )

    def _with_look(
        self,
        canonical: CanonicalFrame,
        T_cam_model: np.ndarray,
        anchor: AbsoluteFit,
        seconds: float,
    ) -> CanonicalFrame:
        return canonical.with_look(
            T_cam_model,
            anchor.T_cam_obj,
            anchor.scale,
            symmetric=self._encoder.symmetric,
            seconds=seconds,
        )

    def _evidence(
        self,
        features: ViewFeatures,
        anchor: AbsoluteFit,
        surface: Track,
        T_cam_obj: np.ndarray,
        scale: float,
    ) -> np.ndarray:
        foreground = float(torch.sigmoid(features.foreground).mean())
        return track_evidence(
            surface.confidence, anchor, T_cam_obj, scale, foreground, self._encoder.symmetric
        )

    def _updated(
        self,
        track: Track,
        frame: RgbdFrame,
        memory: TrackerMemory,
        features: ViewFeatures | None,
    ) -> Track:
        canonical, confidence = memory.canonical, 0.0
        if memory.evidence.any():
            evidence = np.append(memory.surface.confidence, memory.evidence[1:])
            confidence = self.config.confidence(evidence)
        T_cam_obj = memory.surface.T_cam_obj @ canonical.T_model_obj
        count = memory.count.after(confidence, self.config.states)
        memory = replace(memory, count=count)
        if features is not None:
            view = Keyframe(features, T_cam_obj, confidence)
            views = memory.views.with_view(view) if count.good else memory.views
            memory = replace(memory, last=view, views=views)
        return replace(
            track,
            T_cam_obj=T_cam_obj,
            extents=memory.shape * canonical.scale,
            confidence=confidence,
            state=next_state(track.state, count, self.config.states),
            stamp=frame.stamp,
            memory=memory,
        )
