"""Robust6DoF as a tracker: the network, its matches, a memory of views and the canonical anchor."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Bool, Float

from robust6dof.errors import InputError
from robust6dof.frames import SYMMETRIC_CATEGORIES, Box, RgbdFrame, Track, TrackState
from robust6dof.network.inputs import PriorFeatures, ViewFeatures
from robust6dof.network.robust6dof_net import Robust6DofNet
from robust6dof.shapes.priors import load_prior
from robust6dof.tracking.confidence import ConfidenceModel
from robust6dof.tracking.initialisation import find_initial_pose
from robust6dof.tracking.joint_pose import JointPose, JointPoseConfig, solve_joint_pose
from robust6dof.tracking.keyframes import Keyframe, KeyframeMemory
from robust6dof.tracking.motion import Motion, seconds_between
from robust6dof.tracking.pretrained import load_pretrained
from robust6dof.tracking.states import StateCount, StateRules, next_state
from robust6dof.tracking.view import ViewConfig, make_view


@dataclass(frozen=True)
class TrackerConfig:
    """How the network is used."""

    pose: JointPoseConfig = field(default_factory=JointPoseConfig)
    confidence: ConfidenceModel = field(default_factory=ConfidenceModel)
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
class TrackerMemory:
    """What the tracker carries from frame to frame."""

    prior: PriorFeatures
    last: Keyframe
    views: KeyframeMemory
    motion: Motion
    count: StateCount
    frames: int = 0


class Tracker:
    """The network's tracker behind the `PoseTracker` protocol.

    Args:
        net: the network, in evaluation mode.
        prior: the category's shape prior, canonical points of diagonal 1.
        category: its name; decides the symmetry.
        config: see its fields.
        seed: of the points drawn and of RANSAC.
    """

    def __init__(
        self,
        net: Robust6DofNet,
        prior: Float[np.ndarray, "P 3"],
        category: str,
        config: TrackerConfig | None = None,
        *,
        seed: int = 0,
    ) -> None:
        self.net = net.eval()
        self.category = category
        self.config = config or TrackerConfig()
        self._symmetric = category in SYMMETRIC_CATEGORIES
        self._view_config = ViewConfig(points=net.config.points, crop_px=net.config.crop_px)
        self._seed = seed
        self._prior = _encode_prior(net, prior, seed)

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
            config: how the network is used.
            device: auto, cpu or cuda.
            seed: see the class.

        Raises:
            DataError: unusable weights.
            InputError: no prior for the category.
        """
        net = load_pretrained(path, device)
        return cls(net, load_prior(category), category, config, seed=seed)

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
        confidence = self.config.confidence(estimate)
        first = Keyframe(features, T_start, confidence)
        memory = TrackerMemory(
            prior=self._prior,
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
        features = self._encode(frame, T_cam_obj, extents, None, number)
        if features is None:
            raise InputError(
                "no depth on the object in the first frame: check the start pose, the depth's "
                "unit and that the object is in view"
            )
        alone = replace(self.config.pose, anchor_weight=1.0)
        return features, self._solve(features, (), T_cam_obj, extents, number, alone)

    def step(self, track: Track, frame: RgbdFrame) -> Track:
        """Follow the object to `frame`; never raises on a bad image."""
        memory: TrackerMemory = track.memory
        seconds = seconds_between(track.stamp, frame.stamp)
        T_cam_pred = memory.motion.predict(track.T_cam_obj, seconds)
        number = memory.frames + 1
        features = self._encode(frame, T_cam_pred, track.extents, memory.last.features, number)
        if features is None:
            return self._unseen(track, frame)
        stored = memory.views.nearest(T_cam_pred, self.config.pose.stored_views)
        past = [memory.last, *stored] if self.config.memory_capacity else [memory.last]
        estimate = self._solve(features, past, T_cam_pred, track.extents, number)
        return self._followed(track, frame, features, estimate, seconds)

    def _followed(
        self,
        track: Track,
        frame: RgbdFrame,
        features: ViewFeatures,
        estimate: JointPose,
        seconds: float,
    ) -> Track:
        memory: TrackerMemory = track.memory
        confidence = self.config.confidence(estimate)
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
        memory: TrackerMemory = track.memory
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
    def _encode(
        self,
        frame: RgbdFrame,
        T_cam_pred: np.ndarray,
        extents: np.ndarray,
        previous: ViewFeatures | None,
        number: int,
    ) -> ViewFeatures | None:
        rng = np.random.default_rng([self._seed, number])
        view = make_view(frame, T_cam_pred, extents, self._view_config, rng)
        if view is None:
            return None
        batch = view.batch.to(self._prior.points.device)
        return self.net.encode(batch, self._prior, previous)

    @torch.inference_mode()
    def _solve(
        self,
        features: ViewFeatures,
        past: list[Keyframe] | tuple[()],
        T_cam_pred: np.ndarray,
        extents: np.ndarray,
        number: int,
        weights: JointPoseConfig | None = None,
    ) -> JointPose:
        rng = np.random.default_rng([self._seed, number, 1])
        scale = float(np.linalg.norm(extents))
        return solve_joint_pose(
            self.net,
            features,
            past,
            T_cam_pred,
            scale,
            self._symmetric,
            weights or self.config.pose,
            rng,
        )


@torch.inference_mode()
def _encode_prior(net: Robust6DofNet, prior: Float[np.ndarray, "P 3"], seed: int) -> PriorFeatures:
    count = net.config.prior_points
    rng = np.random.default_rng(seed)
    chosen = rng.choice(len(prior), count, replace=len(prior) < count)
    device = next(net.parameters()).device
    points = torch.from_numpy(np.asarray(prior[chosen], dtype=np.float32))[None].to(device)
    return net.encode_prior(points)
