"""Robust6DoF as a tracker: the network says what and where, registration follows the surface.

Each frame:

1. The surface seen so far is registered to the frame, from the motion's prediction.
2. Where that fails, the network's keypoint matches with past views say where to try again; once
   the object is lost, it is looked for in the whole image.
3. The frame's canonical anchor is one more opinion of where the object's frame lies on that
   surface (see `canonical_frame`): so a rough start is corrected and a slip does not stay.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from robust6dof.frames import Box, RgbdFrame, Track, TrackState
from robust6dof.geometry.transforms import invert_transform
from robust6dof.network.inputs import ViewFeatures
from robust6dof.solver.absolute import AbsoluteFit
from robust6dof.tracking.canonical_frame import CanonicalFrame
from robust6dof.tracking.confidence import look_evidence
from robust6dof.tracking.encoder import ViewEncoder, ViewRequest, encode_alone
from robust6dof.tracking.first_look import look_around
from robust6dof.tracking.initialisation import find_initial_pose
from robust6dof.tracking.keyframes import Keyframe, KeyframeMemory
from robust6dof.tracking.likeness import CategoryShape, stands_as_given
from robust6dof.tracking.look import Look, Sight, look_request
from robust6dof.tracking.motion import seconds_between
from robust6dof.tracking.place import PlaceMemory
from robust6dof.tracking.pretrained import category_or_object
from robust6dof.tracking.rescue import Rescue
from robust6dof.tracking.states import FOLLOWED, StateCount, next_state
from robust6dof.tracking.surface.icp import IcpTracker
from robust6dof.tracking.tracker_config import TrackerConfig
from robust6dof.tracking.tracker_memory import TrackerMemory


@dataclass(frozen=True, eq=False)
class BegunStep:
    """Half a step, so that several trackers can share one call of the network."""

    track: Track
    memory: TrackerMemory
    surface: Track
    """Registered to the new frame."""
    looks: bool
    """The network is due; it has nothing to look at where there is no request."""
    lost: bool = False
    """The object was lost before the frame, or it is too long ago that it was seen."""
    request: ViewRequest | None = None


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
        self._shape = CategoryShape(encoder.prior, self.category)
        self._rescue = Rescue(encoder, self._surface, self.config)

    @classmethod
    def from_pretrained(
        cls,
        path: str | Path | None = None,
        *,
        category: str | None = None,
        object: str | None = None,
        config: TrackerConfig | None = None,
        device: str = "auto",
        seed: int = 0,
    ) -> Tracker:
        """A tracker with the shipped weights, or with one's own.

        Args:
            path: weights that `robust6dof train` wrote; the shipped ones if not given.
            category: one with a prior; or instead
            object: one of the 21 of YCB-Video, which have weights of their own.
            config: see its fields.
            device: auto, cpu or cuda.
            seed: of the points drawn and of RANSAC.

        Raises:
            DataError: unusable weights, or none shipped.
            InputError: no prior for the category, no such object, or not one of the two.
        """
        name = category_or_object(category, object)
        return cls(ViewEncoder.from_pretrained(path, name, device, seed), config)

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
        given = T_cam_obj is not None
        doubt = self.config.given_doubt if given else self.config.estimated_doubt
        scale = float(np.linalg.norm(initial.extents))
        shape = initial.extents / scale
        canonical = CanonicalFrame.at_start(scale, doubt, self.config.canonical)
        anchor = look_around(self._encoder, frame, initial, doubt, self.config.first_look)
        if anchor.inlier_share >= self.config.anchor_trust:
            canonical = self._with_look(canonical, initial.T_cam_obj, anchor, 0.0)
        T_cam_obj = initial.T_cam_obj @ canonical.T_model_obj
        canonical = canonical.rebased()
        extents = shape * canonical.scale
        surface = self._surface.start(
            frame, mask=initial.mask, T_cam_obj=T_cam_obj, extents=extents
        )
        features = self._encoder.first(frame, T_cam_obj, extents)
        sight = Sight(features, self._encoder.anchor(features, 0))
        symmetric = self._encoder.symmetric
        evidence = look_evidence(sight.anchor, T_cam_obj, canonical.scale, symmetric)
        T_model_given = invert_transform(T_cam_obj) @ initial.T_cam_obj if given else None
        confidence = self._confidence(surface, evidence)
        first = Keyframe(features, T_cam_obj, confidence)
        views = KeyframeMemory((first,), self.config.memory_capacity)
        place = PlaceMemory().after_sight(frame, surface.T_cam_obj, False, self.config.place)
        memory = TrackerMemory(
            surface, canonical, shape, first, views, evidence, T_model_given, place
        )
        memory = replace(memory, likeness=self._likeness(frame, memory))
        return Track(
            T_cam_obj=T_cam_obj,
            extents=extents,
            confidence=min(confidence, memory.likeness),
            state=TrackState.TRACKING,
            category=self.category,
            stamp=frame.stamp,
            memory=memory,
        )

    def step(self, track: Track, frame: RgbdFrame) -> Track:
        """Follow the object to `frame`; never raises on a bad image."""
        begun = self.begin(track, frame)
        return self.finish(begun, frame, encode_alone(self.net, begun.request))

    def begin(self, track: Track, frame: RgbdFrame) -> BegunStep:
        """The first half of `step`: register, and say what to ask of the network."""
        memory: TrackerMemory = track.memory
        seconds = seconds_between(track.stamp, frame.stamp, longest=np.inf)
        memory = replace(memory, seconds=memory.seconds + seconds, frames=memory.frames + 1)
        jumped = seconds > self.config.jump_s
        sure = track.state is TrackState.TRACKING and not jumped
        lost = self.config.recover and (track.state is TrackState.LOST or jumped)
        if jumped and track.state is TrackState.RECOVERING:
            memory = replace(memory, count=StateCount(), stands=False)
        if self.config.recover and not sure:
            held = lost and track.state is not TrackState.RECOVERING
            memory = memory.following_place(frame, seconds, self.config.place, held)
        due = not sure or memory.frames % self.config.look_every == 0
        learn = sure and (self.config.look_every == 1 or not due)
        surface = self._surface.step(memory.surface, frame, learn=learn)
        if not due and surface.confidence >= self.config.surface_trust:
            return BegunStep(track, memory, surface, looks=False)
        request = look_request(self._encoder, frame, surface, memory)
        return BegunStep(track, memory, surface, looks=True, lost=lost, request=request)

    def finish(self, begun: BegunStep, frame: RgbdFrame, answer: ViewFeatures | None) -> Track:
        """The second half of `step`, with the network's answer to the request."""
        track, memory, surface = begun.track, begun.memory, begun.surface
        if not begun.looks:
            return self._updated(track, frame, replace(memory, surface=surface), None)
        look = Look.answered(self._encoder, surface, memory, answer)
        return self._looked(track, frame, look, memory, begun.lost)

    def _looked(
        self, track: Track, frame: RgbdFrame, look: Look, memory: TrackerMemory, lost: bool
    ) -> Track:
        """The registration's track after the network's look at the frame."""
        found = memory.count.good if track.state is TrackState.RECOVERING else 0
        lost = lost or bool(found and not self._stands(look.surface, memory))
        if lost or look.surface.confidence < self.config.surface_trust:
            look = self._rescue.try_again(frame, look, memory, lost, found)
        if lost and look.searched:
            track = replace(track, state=TrackState.LOST)
            memory = replace(memory, count=StateCount(), stands=False)
        memory = replace(memory, surface=look.surface, evidence=None)
        if look.sight is None:
            return self._updated(track, frame, memory, None)
        learns = track.state in FOLLOWED
        memory = self._judged(frame, look.surface, look.sight, memory, learns)
        return self._updated(track, frame, memory, look.sight.features)

    def _judged(
        self, frame: RgbdFrame, surface: Track, sight: Sight, memory: TrackerMemory, learns: bool
    ) -> TrackerMemory:
        """With what the network's sight says for and against the pose, and of the object frame."""
        anchor = sight.anchor
        fits = surface.confidence >= self.config.surface_trust
        if learns and fits and anchor.inlier_share >= self.config.anchor_trust:
            canonical = self._with_look(memory.canonical, surface.T_cam_obj, anchor, memory.seconds)
            memory = replace(memory, canonical=canonical)
        T_cam_obj, symmetric = memory.T_cam_obj(surface), self._encoder.symmetric
        evidence = look_evidence(anchor, T_cam_obj, memory.canonical.scale, symmetric)
        return replace(memory, evidence=evidence, likeness=self._likeness(frame, memory))

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

    def _likeness(self, frame: RgbdFrame, memory: TrackerMemory) -> float:
        T_model_obj, T_model_given = memory.canonical.T_model_obj, memory.T_model_given
        symmetric = self._encoder.symmetric
        if T_model_given is not None and stands_as_given(T_model_obj, T_model_given, symmetric):
            return 1.0
        T_cam_obj = memory.T_cam_obj(memory.surface)
        return self._shape.likeness(frame, T_cam_obj, memory.extents, memory.seen_points)

    def _confidence(self, surface: Track, evidence: np.ndarray | None) -> float:
        """That the object is followed. What looks strange can be followed all the same, so its
        likeness counts in what is claimed alone."""
        if evidence is None:
            return 0.0
        registered = self.config.surface_share * surface.confidence
        return min(self.config.confidence(evidence), registered)

    def _updated(
        self,
        track: Track,
        frame: RgbdFrame,
        memory: TrackerMemory,
        features: ViewFeatures | None,
    ) -> Track:
        confidence = self._confidence(memory.surface, memory.evidence)
        T_cam_obj = memory.T_cam_obj(memory.surface)
        count = memory.count.after(confidence, self.config.states)
        memory = replace(memory, count=count)
        if features is not None:
            view = Keyframe(features, T_cam_obj, confidence)
            learns = count.good and track.state in FOLLOWED
            views = memory.views.with_view(view) if learns else memory.views
            memory = replace(memory, last=view, views=views)
        stands = self._stands(memory.surface, memory)
        state = next_state(track.state, count, self.config.states, stands)
        if state is TrackState.TRACKING:
            forgets = track.state is TrackState.RECOVERING and not stands
            memory = replace(memory, place=self._place_seen(frame, memory, forgets))
        memory = replace(memory, stands=stands and state is TrackState.RECOVERING)
        return replace(
            track,
            T_cam_obj=T_cam_obj,
            extents=memory.extents,
            confidence=0.0 if state is TrackState.LOST else min(confidence, memory.likeness),
            state=state,
            stamp=frame.stamp,
            memory=memory,
        )

    def _stands(self, surface: Track, memory: TrackerMemory) -> bool:
        """Whether the object is where it stood when it was lost; if not, what was found may still
        turn out to be something else. In a frame that does not tell it is as it was."""
        if not self.config.recover:
            return True
        if not memory.place.known:
            return memory.stands
        symmetric, config = self._encoder.symmetric, self.config.place
        return memory.place.confirms(surface.T_cam_obj, symmetric, config)

    def _place_seen(
        self, frame: RgbdFrame, memory: TrackerMemory, elsewhere: bool = False
    ) -> PlaceMemory:
        """The object is seen; `elsewhere` than where it stood, of which nothing is kept."""
        surface = memory.surface
        moving = surface.memory.surroundings is None
        before = PlaceMemory() if elsewhere else memory.place
        return before.after_sight(frame, surface.T_cam_obj, moving, self.config.place)
