"""Frame-to-model ICP: a tracker that needs no training.

Each frame's points near the predicted box are registered, coarse to fine, to the object's surface
as seen so far, together with the plane that the object stands on. What keeps it from drifting:

- the model grows only with a good fit and a new viewpoint, and averages what it knows already;
- the supporting plane fixes tilt and height while the object stands on it, and is let go when the
  object leaves it;
- where there is colour, the model keeps it, so that a cup's print fixes its turn;
- what remains free follows the motion prediction instead of sliding.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Bool, Float

from robust6dof.baselines.fit_quality import NOTHING_SEEN, FitQuality, assess
from robust6dof.baselines.frame_cut import CutConfig, FrameCut, cut_frame
from robust6dof.baselines.registration import Prior, Stage, register
from robust6dof.baselines.registration_target import RegistrationTarget
from robust6dof.baselines.surface_model import SurfaceModel
from robust6dof.errors import InputError
from robust6dof.frames import Box, RgbdFrame, Track, TrackState
from robust6dof.geometry.transforms import check_transform, invert_transform, transform_points
from robust6dof.tracking.initialisation import InitialPose, find_initial_pose
from robust6dof.tracking.motion import Motion, seconds_between
from robust6dof.tracking.region import depth_noise
from robust6dof.tracking.support_plane import Plane, find_support_plane, least_squares_plane


@dataclass(frozen=True)
class IcpConfig:
    """Lengths called shares are multiplied by the diagonal of the object's box."""

    cut: CutConfig = field(default_factory=CutConfig)
    voxel_share: float = 0.025
    """Side of the model's voxels, …"""
    voxel_range_m: tuple[float, float] = (0.0025, 0.008)
    """… within these."""
    max_model_points: int = 5000
    cutoff_shares: tuple[float, float, float] = (0.25, 0.10, 0.05)
    """Largest correspondence distance, from coarse to fine, …"""
    cutoff_limits_m: tuple[float, float, float] = (0.06, 0.03, 0.015)
    """… but no more than this."""
    iterations: tuple[int, int, int] = (4, 5, 6)
    """Of each stage, at most."""
    search_share: float = 0.15
    """How far outside the predicted box points are still taken."""
    linear_acceleration: float = 15.0
    """Of the object in the camera frame [m/s²]: the doubt in the motion prediction, which decides
    only where the images say little."""
    angular_acceleration: float = 50.0
    """[rad/s²]"""
    keyframe_angle_deg: float = 4.0
    """The model takes in a view that differs by this much from all before, …"""
    keyframe_distance_ratio: float = 1.15
    """… or that is nearer by this ratio."""
    settle_frames: int = 5
    """The first frames are all averaged into the model."""
    growth_confidence: float = 0.7
    """The model takes in nothing below this confidence."""
    tracking_confidence: float = 0.5
    """TRACKING at or above, UNCERTAIN below."""
    lost_confidence: float = 0.2
    """Below this for `lost_frames` frames in a row: LOST."""
    lost_frames: int = 3
    plane_tolerance_m: float = 0.012
    """The plane is let go when what is seen of it differs by more than this, …"""
    plane_tolerance_deg: float = 6.0
    """… or this, …"""
    plane_patience: int = 5
    """… for this many frames in a row."""


@dataclass(frozen=True, eq=False)
class IcpMemory:
    """What the ICP carries from frame to frame."""

    surface: SurfaceModel
    target: RegistrationTarget
    plane: Plane | None
    """The supporting plane in the object frame, while the object stands on it."""
    keyframes: Float[np.ndarray, "F 4"]
    """Unit view direction in the object frame and distance [m] of each view in the model."""
    motion: Motion
    frames: int = 1
    bad_frames: int = 0
    good_frames: int = 0
    plane_misses: int = 0


@dataclass(frozen=True, eq=False)
class _Fit:
    T_cam_obj: Float[np.ndarray, "4 4"]
    quality: FitQuality
    plane_points: Float[np.ndarray, "R 3"]
    """What was seen of the supporting plane, in the fitted object frame [m]."""


class IcpTracker:
    """Frame-to-model ICP behind the `PoseTracker` protocol.

    States: TRACKING while the confidence is at least `tracking_confidence`; UNCERTAIN below; LOST
    after `lost_frames` frames below `lost_confidence` or once the box has left the image (the last
    pose is held); RECOVERING from the first good frame after a loss until `lost_frames` good ones.
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
        return self._started(frame, initial)

    def _started(self, frame: RgbdFrame, initial: InitialPose) -> Track:
        T_cam_obj, extents = initial.T_cam_obj, initial.extents
        plane = find_support_plane(frame, T_cam_obj, extents, np.random.default_rng(self._seed))
        share = self.config.voxel_share * float(np.linalg.norm(extents))
        blank = SurfaceModel.empty(
            float(np.clip(share, *self.config.voxel_range_m)), self.config.max_model_points
        )
        cut = self._cut(frame, T_cam_obj, extents, blank.voxel, plane, 0.02, initial.mask)
        if cut is None or not len(cut.surface):
            raise InputError(
                "no depth on the object in the first frame: check the start pose, the depth's "
                "unit and that the object is in view"
            )
        surface = blank.merged(cut.surface, _view_weight(T_cam_obj))
        memory = IcpMemory(
            surface=surface,
            target=RegistrationTarget.build(surface.cloud, plane, extents),
            plane=plane,
            keyframes=_view_of(T_cam_obj)[None],
            motion=Motion.at_rest(),
        )
        return Track(
            T_cam_obj=T_cam_obj,
            extents=extents,
            confidence=_assess(frame, T_cam_obj, surface)[0].confidence,
            state=TrackState.TRACKING,
            category=self.category,
            stamp=frame.stamp,
            memory=memory,
        )

    def step(self, track: Track, frame: RgbdFrame) -> Track:
        """Follow the object to `frame`; never raises on a bad image."""
        memory: IcpMemory = track.memory
        seconds = seconds_between(track.stamp, frame.stamp)
        fit = self._fit(frame, memory.motion.predict(track.T_cam_obj, seconds), track, seconds)
        if fit.quality.confidence < self.config.tracking_confidence:
            at_rest = self._fit(frame, track.T_cam_obj, track, seconds)
            if at_rest.quality.confidence > fit.quality.confidence:
                fit = at_rest
        memory = self._counted(memory, fit.quality.confidence)
        track = replace(
            track,
            confidence=fit.quality.confidence,
            state=self._next_state(track.state, memory, fit.quality),
            stamp=frame.stamp,
            memory=replace(memory, motion=Motion.at_rest()),
        )
        if fit.quality.confidence < self.config.lost_confidence:
            return track
        newest = Motion.between(track.T_cam_obj, fit.T_cam_obj, seconds)
        memory = replace(memory, motion=memory.motion.blended(newest, 0.5))
        memory = self._watch_plane(memory, fit.plane_points, track.extents)
        track = replace(track, T_cam_obj=fit.T_cam_obj, memory=memory)
        return self._learned(track, frame)

    def _counted(self, memory: IcpMemory, confidence: float) -> IcpMemory:
        bad = confidence < self.config.lost_confidence
        good = confidence >= self.config.tracking_confidence
        return replace(
            memory,
            frames=memory.frames + 1,
            bad_frames=memory.bad_frames + 1 if bad else 0,
            good_frames=memory.good_frames + 1 if good else 0,
        )

    def _next_state(self, state: TrackState, memory: IcpMemory, quality: FitQuality) -> TrackState:
        good = memory.good_frames > 0
        if state in (TrackState.LOST, TrackState.RECOVERING):
            if not good:
                return TrackState.LOST
            settled = memory.good_frames >= self.config.lost_frames
            return TrackState.TRACKING if settled else TrackState.RECOVERING
        if memory.bad_frames >= self.config.lost_frames or quality is NOTHING_SEEN:
            return TrackState.LOST
        return TrackState.TRACKING if good else TrackState.UNCERTAIN

    def _fit(self, frame: RgbdFrame, T_predicted: np.ndarray, track: Track, seconds: float) -> _Fit:
        config, memory = self.config, track.memory
        nothing = _Fit(T_predicted, NOTHING_SEEN, np.zeros((0, 3)))
        cut = self._cut(
            frame,
            T_predicted,
            track.extents,
            memory.surface.voxel,
            memory.plane,
            config.search_share,
        )
        if cut is None or not len(cut.surface):
            return nothing
        noise = float(depth_noise(T_predicted[2, 3]))
        registration = register(
            cut.joined(memory.plane),
            memory.target,
            stages=self._stages(track.scale, noise),
            noise=noise,
            prior=self._prior(seconds, memory),
        )
        if registration is None:
            return nothing
        T_fit_predicted = registration.T_target_source
        T_cam_obj = check_transform(T_predicted @ invert_transform(T_fit_predicted))
        quality, _ = _assess(frame, T_cam_obj, memory.surface)
        return _Fit(T_cam_obj, quality, transform_points(T_fit_predicted, cut.plane_points))

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

    def _prior(self, seconds: float, memory: IcpMemory) -> Prior:
        """What the acceleration can change in one step; more before the velocity is known."""
        config = self.config
        half = 0.5 * seconds**2 * (4.0 if memory.frames < 4 or memory.bad_frames else 1.0)
        return Prior(config.angular_acceleration * half, config.linear_acceleration * half)

    def _cut(
        self,
        frame: RgbdFrame,
        T_cam_obj: np.ndarray,
        extents: np.ndarray,
        voxel: float,
        plane: Plane | None,
        margin_share: float,
        mask: np.ndarray | None = None,
    ) -> FrameCut | None:
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

    def _watch_plane(
        self, memory: IcpMemory, plane_points: np.ndarray, extents: np.ndarray
    ) -> IcpMemory:
        """Let the plane go once the scene's own plane has left it for some frames."""
        if memory.plane is None or len(plane_points) < 30:
            return memory
        seen = least_squares_plane(plane_points)
        tilt = np.degrees(np.arccos(min(1.0, abs(float(seen.normal @ memory.plane.normal)))))
        gap = float(np.median(np.abs(memory.plane.height(plane_points))))
        config = self.config
        off = tilt > config.plane_tolerance_deg or gap > config.plane_tolerance_m
        misses = memory.plane_misses + 1 if off else 0
        if misses < config.plane_patience:
            return replace(memory, plane_misses=misses)
        target = RegistrationTarget.build(memory.surface.cloud, None, extents)
        return replace(memory, plane=None, plane_misses=0, target=target)

    def _learned(self, track: Track, frame: RgbdFrame) -> Track:
        """Take the view into the model where it is new and the fit is good."""
        memory: IcpMemory = track.memory
        view = _view_of(track.T_cam_obj)
        trusted = track.confidence >= self.config.growth_confidence
        settling = memory.frames <= self.config.settle_frames
        if (
            not trusted
            or track.state is not TrackState.TRACKING
            or not (settling or self._is_new_view(view, memory.keyframes))
        ):
            return track
        cut = self._cut(
            frame, track.T_cam_obj, track.extents, memory.surface.voxel, memory.plane, 0.02
        )
        if cut is None:
            return track
        _, refuted = _assess(frame, track.T_cam_obj, memory.surface, every=1)
        surface = memory.surface.carved(refuted).merged(cut.surface, _view_weight(track.T_cam_obj))
        memory = replace(
            memory,
            surface=surface,
            target=RegistrationTarget.build(surface.cloud, memory.plane, track.extents),
            keyframes=np.concatenate([memory.keyframes, view[None]]),
        )
        return replace(track, memory=memory)

    def _is_new_view(self, view: np.ndarray, keyframes: np.ndarray) -> bool:
        cosines = np.clip(keyframes[:, :3] @ view[:3], -1.0, 1.0)
        far = np.degrees(np.arccos(cosines)) > self.config.keyframe_angle_deg
        nearer = keyframes[:, 3] > self.config.keyframe_distance_ratio * view[3]
        return bool((far | nearer).all())


def _assess(
    frame: RgbdFrame, T_cam_obj: np.ndarray, surface: SurfaceModel, every: int = 0
) -> tuple[FitQuality, Bool[np.ndarray, "P"]]:
    step = every or max(1, len(surface) // 1000)
    cloud = surface.cloud
    return assess(
        frame, T_cam_obj, cloud.points[::step], cloud.normals[::step], spacing=surface.voxel
    )


def _view_weight(T_cam_obj: np.ndarray) -> float:
    """Of a view's points: the inverse variance of their depth, near 1 under a millimetre."""
    return float(1e-6 / (1e-6 + depth_noise(T_cam_obj[2, 3]) ** 2))


def _view_of(T_cam_obj: np.ndarray) -> Float[np.ndarray, "4"]:
    """Direction to the camera in the object frame, and its distance [m]."""
    camera = invert_transform(T_cam_obj)[:3, 3]
    distance = float(np.linalg.norm(camera))
    return np.append(camera / max(distance, 1e-9), distance)
