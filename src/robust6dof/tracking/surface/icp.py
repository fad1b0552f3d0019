"""Frame-to-model ICP: a tracker that needs no training.

Each frame's points near the predicted box are registered, coarse to fine, to the object's surface
as seen so far. What keeps it from drifting:

- the model grows only with a good fit and a new viewpoint, and averages what it knows already;
- where there is colour, the model keeps it, so that a cup's print fixes its turn;
- while the object stands still among its surroundings, both are registered as one;
- what remains free follows the motion prediction instead of sliding.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Bool, Float

from robust6dof.errors import InputError
from robust6dof.frames import Box, RgbdFrame, Track, TrackState
from robust6dof.geometry.transforms import check_transform, invert_transform
from robust6dof.tracking.initialisation import NOTHING_THERE, InitialPose, find_initial_pose
from robust6dof.tracking.motion import Motion, seconds_between
from robust6dof.tracking.region import depth_noise
from robust6dof.tracking.states import StateCount, StateRules, next_state
from robust6dof.tracking.support_plane import Plane, find_support_plane
from robust6dof.tracking.surface.cloud import Cloud
from robust6dof.tracking.surface.fit_quality import NOTHING_SEEN, FitQuality
from robust6dof.tracking.surface.frame_cut import cut_frame
from robust6dof.tracking.surface.icp_config import IcpConfig
from robust6dof.tracking.surface.icp_memory import IcpMemory, assess_surface, view_of, view_weight
from robust6dof.tracking.surface.registration import (
    Evidence,
    Registration,
    Stage,
    independent,
    register,
)
from robust6dof.tracking.surface.registration_target import RegistrationTarget
from robust6dof.tracking.surface.surface_model import SurfaceModel
from robust6dof.tracking.surface.surroundings import Surroundings

_LEARNING_MARGIN = 0.02
"""How far outside the box a view's points are taken into the model, as a share of its diagonal."""

_APART_ITERATIONS = 3
"""Of the object alone, from where it is found with its surroundings."""


@dataclass(frozen=True, eq=False)
class _Fit:
    T_cam_obj: Float[np.ndarray, "4 4"]
    quality: FitQuality
    left: bool = False
    """Whether the object was found away from its surroundings."""
    seen_rotation: Float[np.ndarray, "3 3"] = field(default_factory=lambda: np.eye(3))
    """As in `Registration`, camera axes: what was not seen to turn is not believed to turn on."""


class IcpTracker:
    """Frame-to-model ICP behind the `PoseTracker` protocol.

    States as in `tracking.states`, and LOST at once where nothing of the box is in view. While
    the fit is bad, the pose goes on with the surroundings, or holds.
    """

    def __init__(
        self, category: str = "object", config: IcpConfig | None = None, *, seed: int = 0
    ) -> None:
        self.category = category
        self.config = config or IcpConfig()
        self._seed = seed

    def start(
        self,
        frame: RgbdFrame,
        *,
        mask: Bool[np.ndarray, "H W"] | None = None,
        box: Box | None = None,
        T_cam_obj: Float[np.ndarray, "4 4"] | None = None,
        extents: Float[np.ndarray, "3"] | None = None,
    ) -> Track:
        """Begin from a pose, a mask, a box, or by itself; see `find_initial_pose`."""
        initial = find_initial_pose(
            frame, self.category, mask=mask, box=box, T_cam_obj=T_cam_obj, extents=extents
        )
        return self._begun(frame, initial)

    def _begun(self, frame: RgbdFrame, initial: InitialPose) -> Track:
        memory = self._first_memory(frame, initial)
        quality, _ = assess_surface(frame, initial.T_cam_obj, memory.surface)
        memory = replace(memory, quality=quality)
        return Track(
            T_cam_obj=initial.T_cam_obj,
            extents=initial.extents,
            confidence=quality.confidence,
            state=TrackState.TRACKING,
            category=self.category,
            stamp=frame.stamp,
            memory=memory,
        )

    def step(self, track: Track, frame: RgbdFrame, *, learn: bool = True) -> Track:
        """Follow the object to `frame`; never raises on a bad image.

        Args:
            track: of the last frame.
            frame: the image.
            learn: take what is new in it into the model; a caller short of time may put it off.
        """
        seconds = seconds_between(track.stamp, frame.stamp)
        memory: IcpMemory = track.memory
        prior = self._prior(memory, seconds)
        T_predicted = memory.motion.predict(track.T_cam_obj, seconds, frame.R_ref_cam)
        fit = self._fit(frame, T_predicted, prior, track)
        if fit.quality.confidence < self.config.states.sure:
            T_held = memory.motion.held(track.T_cam_obj, frame.R_ref_cam)
            again = self._fit(frame, T_held, prior, track, carefully=True)
            fit = max(fit, again, key=lambda one: one.quality.confidence)
        count = memory.count.after(fit.quality.confidence, self.config.states)
        memory = replace(memory, frames=memory.frames + 1, count=count, quality=fit.quality)
        state = _state_after(track.state, fit.quality, count, self.config.states)
        lost, confidence = state is TrackState.LOST, fit.quality.confidence
        memory = memory.on_probation(lost, confidence, self.config)
        if confidence < self.config.states.lost:
            T_held = self._carried(frame, T_predicted, prior, track)
            memory = replace(memory, motion=memory.motion.stopped(frame.R_ref_cam))
            return _updated(track, frame, _Fit(T_held, fit.quality), state, memory)
        T_old, T_new = track.T_cam_obj, fit.T_cam_obj
        newest = memory.motion.observed(T_old, T_new, seconds, frame.R_ref_cam)
        newest = newest.turning(fit.seen_rotation)
        memory = replace(memory, motion=memory.motion.blended(newest, 0.5))
        memory = memory.watching_own_motion(fit.left, self.config)
        track = _updated(track, frame, fit, state, memory)
        return self._learned(track, frame) if learn else track

    def _first_memory(self, frame: RgbdFrame, initial: InitialPose) -> IcpMemory:
        T_cam_obj, extents = initial.T_cam_obj, initial.extents
        plane = find_support_plane(frame, T_cam_obj, extents, np.random.default_rng(self._seed))
        share = self.config.voxel_share * float(np.linalg.norm(extents))
        blank = SurfaceModel.empty(
            float(np.clip(share, *self.config.voxel_range_m)), self.config.max_model_points
        )
        view = self._cut(
            frame, T_cam_obj, extents, blank.voxel, plane, _LEARNING_MARGIN, initial.mask
        )
        if not len(view):
            raise InputError(NOTHING_THERE)
        surface = self._first_surface(blank, view, T_cam_obj)
        return IcpMemory(
            surface=surface,
            target=RegistrationTarget.build(surface.cloud),
            plane=plane,
            keyframes=view_of(T_cam_obj)[None],
            motion=Motion.at_rest(frame.R_ref_cam),
            surroundings=Surroundings.seen_in(frame, T_cam_obj, extents, self.config.surroundings),
        )

    def _first_surface(
        self, blank: SurfaceModel, view: Cloud, T_cam_obj: np.ndarray
    ) -> SurfaceModel:
        return blank.merged(view, view_weight(T_cam_obj))

    def _prior(self, memory: IcpMemory, seconds: float) -> Float[np.ndarray, "6 6"]:
        """Doubt in constant velocity: what the acceleration can change in one step, and more
        before the velocity is known."""
        config = self.config
        half = 0.5 * seconds**2 * (4.0 if memory.frames < 4 or memory.count.bad else 1.0)
        return independent(config.angular_acceleration * half, config.linear_acceleration * half)

    def _fit(
        self,
        frame: RgbdFrame,
        T_predicted: np.ndarray,
        prior: np.ndarray,
        track: Track,
        carefully: bool = False,
    ) -> _Fit:
        """The object together with its surroundings, unless it is clearly found elsewhere."""
        memory: IcpMemory = track.memory
        voxel, plane = memory.surface.voxel, memory.plane
        share = self.config.search_share
        view = self._cut(frame, T_predicted, track.extents, voxel, plane, share)
        if not len(view):
            return _Fit(T_predicted, NOTHING_SEEN)
        noise = float(depth_noise(T_predicted[2, 3]))
        stages = self._stages(track.scale, noise)
        if track.state is TrackState.TRACKING and memory.frames > 3 and not carefully:
            stages = stages[1:]
        alone = [Evidence(view, memory.target, noise)]
        together = alone + self._around(frame, T_predicted, noise, track)
        registration = register(together, stages, prior)
        if registration is None:
            return _Fit(T_predicted, NOTHING_SEEN)
        left = False
        if len(together) > 1:
            apart_stage = replace(stages[-1], iterations=_APART_ITERATIONS)
            apart = register(alone, [apart_stage], prior, registration.T_target_source)
            left = apart is not None and self._has_left(registration, apart)
            registration = apart if left and apart is not None else registration
        T_cam_obj = check_transform(T_predicted @ invert_transform(registration.T_target_source))
        R = T_cam_obj[:3, :3]
        seen_rotation = R @ registration.seen_rotation @ R.T
        quality, _ = assess_surface(frame, T_cam_obj, memory.surface)
        return _Fit(T_cam_obj, quality, left, seen_rotation)

    def _around(
        self, frame: RgbdFrame, T_predicted: np.ndarray, noise: float, track: Track
    ) -> list[Evidence]:
        around: Surroundings | None = track.memory.surroundings
        if around is None:
            return []
        view = around.cut(frame, T_predicted, track.extents)
        if len(view) < around.config.least_points:
            return []
        return [Evidence(view, around.target, noise, around.config.voxel_m)]

    def _has_left(self, together: Registration, apart: Registration) -> bool:
        """Whether the surroundings do not fit, or the object alone lies clearly elsewhere (judged
        at its centre)."""
        if together.shares[1] < self.config.least_surroundings:
            return True
        gap = together.T_target_source[:3, 3] - apart.T_target_source[:3, 3]
        doubt = np.linalg.inv(apart.information)[3:, 3:]
        far = float(np.linalg.norm(gap)) > self.config.own_motion_m
        return far and float(gap @ np.linalg.solve(doubt, gap)) > self.config.own_motion_sigmas**2

    def _carried(
        self, frame: RgbdFrame, T_predicted: np.ndarray, prior: np.ndarray, track: Track
    ) -> Float[np.ndarray, "4 4"]:
        """Where the surroundings alone put the object, while it is hidden; else where it was, for
        all that is known of the camera."""
        noise = float(depth_noise(T_predicted[2, 3]))
        around = self._around(frame, T_predicted, noise, track)
        fit = register(around, self._stages(track.scale, noise), prior) if around else None
        if fit is None or fit.shares[0] < self.config.least_surroundings:
            return track.memory.motion.held(track.T_cam_obj, frame.R_ref_cam)
        return check_transform(T_predicted @ invert_transform(fit.T_target_source))

    def _stages(self, scale: float, noise: float) -> list[Stage]:
        config = self.config
        shares, limits = config.cutoff_shares, config.cutoff_limits_m
        coarse, middle, fine = (
            max(min(share * scale, limit), 3.0 * noise)
            for share, limit in zip(shares, limits, strict=True)
        )
        return [
            Stage(coarse, config.iterations[0], 3, color=False, small_m=1e-3, small_rad=5e-3),
            Stage(middle, config.iterations[1], 2, small_m=4e-4, small_rad=2e-3),
            Stage(fine, config.iterations[2]),
        ]

    def _cut(
        self,
        frame: RgbdFrame,
        T_cam_obj: np.ndarray,
        extents: np.ndarray,
        voxel: float,
        plane: Plane | None,
        margin_share: float,
        mask: np.ndarray | None = None,
    ) -> Cloud:
        return cut_frame(
            frame,
            T_cam_obj,
            extents,
            plane,
            margin=margin_share * float(np.linalg.norm(extents)),
            voxel=voxel,
            config=self.config.cut,
            mask=mask,
        )

    def _learned(self, track: Track, frame: RgbdFrame) -> Track:
        """Take the view into the models where it is new and the fit is good."""
        memory: IcpMemory = track.memory
        if not memory.is_trusted(self.config) or track.state is not TrackState.TRACKING:
            return track
        T_cam_obj, extents = track.T_cam_obj, track.extents
        if memory.surroundings is None and memory.free_frames >= self.config.retry_frames:
            surroundings = Surroundings.seen_in(frame, T_cam_obj, extents, self.config.surroundings)
            memory = replace(memory, surroundings=surroundings, free_frames=0)
        if memory.wants(T_cam_obj, self.config):
            voxel, plane = memory.surface.voxel, memory.plane
            view = self._cut(frame, T_cam_obj, extents, voxel, plane, _LEARNING_MARGIN)
            memory = memory.with_view(frame, T_cam_obj, extents, view)
        return replace(track, memory=memory)


def _state_after(
    state: TrackState, quality: FitQuality, count: StateCount, rules: StateRules
) -> TrackState:
    return TrackState.LOST if quality is NOTHING_SEEN else next_state(state, count, rules)


def _updated(
    track: Track, frame: RgbdFrame, fit: _Fit, state: TrackState, memory: IcpMemory
) -> Track:
    return replace(
        track,
        T_cam_obj=fit.T_cam_obj,
        confidence=fit.quality.confidence,
        state=state,
        stamp=frame.stamp,
        memory=memory,
    )
