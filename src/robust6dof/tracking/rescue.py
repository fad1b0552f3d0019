"""A second try where the registration fails: from where the network puts the object."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Float

from robust6dof.frames import RgbdFrame, Track
from robust6dof.network.inputs import ViewFeatures
from robust6dof.tracking.encoder import ViewEncoder
from robust6dof.tracking.joint_pose import solve_joint_pose
from robust6dof.tracking.look import Look
from robust6dof.tracking.recovery import is_same_pose, other_turns, poses_to_try, seen_poses
from robust6dof.tracking.surface.icp import IcpTracker
from robust6dof.tracking.tracker_config import TrackerConfig
from robust6dof.tracking.tracker_memory import TrackerMemory


class Rescue:
    """Proposes poses, registers from there, and believes what the network confirms.

    Args:
        encoder: the network.
        surface: the registration.
        config: of the tracker.
    """

    def __init__(self, encoder: ViewEncoder, surface: IcpTracker, config: TrackerConfig) -> None:
        self._encoder = encoder
        self._surface = surface
        self._config = config

    def try_again(
        self, frame: RgbdFrame, look: Look, memory: TrackerMemory, lost: bool, found: int = 0
    ) -> Look:
        """The look that fits best, among `look` and those that the network confirms.

        Once the object is lost only what registration and network both confirm counts; without
        any such the sight is None.

        Args:
            frame: the image.
            look: at what registration holds.
            memory: of the frame before.
            lost: look everywhere.
            found: in so many frames `look` was taken for the lost object.
        """
        held = self._config.surface_trust
        trust = self._config.recovery.trust if lost else held
        tried = [
            self._registered_from(T, frame, memory)
            for T in self._proposals(frame, look, memory, lost, found)
        ]
        placed = [one for one in tried if one.confidence >= trust]
        looks = [
            replace(Look.take(self._encoder, frame, one, memory), searched=True) for one in placed
        ]
        if look.surface.confidence >= (held if found else trust):
            looks.append(look)
        believed = [one for one in looks if self._is_confirmed(one, memory)]
        if not lost:
            return max([*believed, look], key=lambda one: one.surface.confidence)
        stays = [self._config.recovery.stays if one is look else 0.0 for one in believed]
        beliefs = [self._belief(one.surface, memory) for one in believed] + np.array(stays)
        if not np.isfinite(beliefs).any():
            return Look(self._held(look.surface, memory), None)
        best = believed[int(np.argmax(beliefs))]
        return replace(best, surface=self._on_probation(best.surface))

    def _on_probation(self, surface: Track) -> Track:
        memory = surface.memory.on_probation(True, 0.0, self._config.surface)
        return replace(surface, memory=memory)

    def _held(self, surface: Track, memory: TrackerMemory) -> Track:
        """Where the object was, unless the registration itself holds or carries it; nothing of a
        refused registration stays."""
        if surface.confidence < self._config.surface.states.lost:
            return surface
        held = memory.surface_at(memory.surface.T_cam_obj)
        return replace(held, confidence=0.0, stamp=surface.stamp)

    def _proposals(
        self, frame: RgbdFrame, look: Look, memory: TrackerMemory, lost: bool, found: int
    ) -> list[Float[np.ndarray, "4 4"]]:
        """T_cam_obj by the matches with past views; once the object is lost, of all that could
        be it."""
        T_cam_pred = memory.T_cam_obj(look.surface)
        proposals = []
        if look.sight is not None:
            proposals.append(self._matched(frame, T_cam_pred, look.sight.features, memory))
        if lost:
            proposals += self._places(memory)
        if lost and memory.place.worth_a_search(frame, self._config.place):
            proposals += self._found_in_image(frame, look, memory, found)
        return proposals

    def _places(self, memory: TrackerMemory) -> list[Float[np.ndarray, "4 4"]]:
        """Where the object should be, but for where the registration begins anyway."""
        begun = memory.surface.T_cam_obj
        known = [T for T in memory.place.known if not np.array_equal(T, begun)]
        return [T @ memory.canonical.T_model_obj for T in known]

    def _found_in_image(
        self, frame: RgbdFrame, look: Look, memory: TrackerMemory, found: int
    ) -> list[Float[np.ndarray, "4 4"]]:
        """What the network sees of all that could be the object; once something is found, of its
        other turns first."""
        config = self._config.recovery
        guesses = self._guesses(frame, memory)
        if found and not self._encoder.symmetric:
            turns = other_turns(memory.T_cam_obj(look.surface), config)
            guesses = self._within_reach(turns, memory) + guesses
        number = found - 1 if found else memory.frames
        return seen_poses(self._encoder, frame, guesses, memory.extents, number, config)

    def _guesses(self, frame: RgbdFrame, memory: TrackerMemory) -> list[Float[np.ndarray, "4 4"]]:
        """Its place, if that is known, and what may be the object within its reach."""
        scale, config = memory.canonical.scale, self._config.recovery
        color = memory.surface.memory.surface.mean_color
        T_cam_place = memory.place.T_cam_obj
        at = memory.surface if T_cam_place is None else memory.surface_at(T_cam_place)
        T_cam_last = memory.T_cam_obj(at)
        guesses = poses_to_try(frame, T_cam_last, scale, color, self._encoder.symmetric, config)
        guesses = self._within_reach(guesses, memory)
        return guesses if T_cam_place is None else [T_cam_last, *guesses]

    def _within_reach(
        self, guesses: Sequence[Float[np.ndarray, "4 4"]], memory: TrackerMemory
    ) -> list[Float[np.ndarray, "4 4"]]:
        """Those where the object can be by now."""
        return [T for T in guesses if np.isfinite(self._surprise(memory.T_cam_model(T), memory))]

    @torch.inference_mode()
    def _matched(
        self,
        frame: RgbdFrame,
        T_cam_pred: np.ndarray,
        features: ViewFeatures,
        memory: TrackerMemory,
    ) -> Float[np.ndarray, "4 4"]:
        """T_cam_obj from the keypoint matches with the last and the nearest stored views."""
        past = [memory.last, *memory.views.nearest(T_cam_pred, self._config.pose.stored_views)]
        return solve_joint_pose(
            self._encoder.net,
            features,
            past,
            T_cam_pred,
            memory.canonical.scale,
            self._encoder.symmetric,
            frame.K,
            self._config.pose,
            np.random.default_rng([self._encoder.seed, memory.frames, 1]),
        ).T_cam_obj

    def _registered_from(
        self, T_cam_obj: np.ndarray, frame: RgbdFrame, memory: TrackerMemory
    ) -> Track:
        """Registration that begins with the object here and at rest."""
        at_rest = memory.surface_at(memory.T_cam_model(T_cam_obj))
        return self._surface.step(at_rest, frame, learn=False)

    def _belief(self, surface: Track, memory: TrackerMemory) -> float:
        """Log likelihood of this being the lost object: it fits, in shape and colour, and is not
        far from its place."""
        gap = surface.memory.quality.color_gap / self._config.recovery.color_gap
        fits = float(np.log(max(surface.confidence, 1e-6))) - gap
        return fits - self._surprise(surface.T_cam_obj, memory)

    def _surprise(self, T_cam_model: np.ndarray, memory: TrackerMemory) -> float:
        return memory.place.surprise(T_cam_model, self._encoder.symmetric, self._config.place)

    def _is_confirmed(self, look: Look, memory: TrackerMemory) -> bool:
        """Whether the network, looking there, sees the object as it is registered."""
        if look.sight is None:
            return False
        T_cam_obj, scale = memory.T_cam_obj(look.surface), memory.canonical.scale
        return is_same_pose(look.sight.anchor, T_cam_obj, scale, self._encoder.symmetric)
