"""Frame-to-model ICP: a tracker that needs no training, from depth alone.

Each frame's points near the predicted box are registered (generalised ICP of small_gicp,
correspondence distance from coarse to fine) to the object's surface as seen so far, together with
the plane that the object stands on. What keeps it from drifting:

- the model grows only with a good fit and a new viewpoint, and averages what it knows already;
- the supporting plane fixes tilt and height while the object stands on it, and is let go when the
  object leaves it;
- where the geometry leaves a direction free (a cup's turn about its axis), the pose follows the
  motion prediction instead of sliding.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import small_gicp
from jaxtyping import Bool, Float

from robust6dof.baselines.fit_quality import NOTHING_SEEN, FitQuality, assess
from robust6dof.baselines.registration import Prior, Registration, register
from robust6dof.baselines.surface_model import RegistrationTarget, SurfaceModel, plane_radius
from robust6dof.errors import InputError
from robust6dof.frames import Box, RgbdFrame, Track, TrackState
from robust6dof.geometry.transforms import (
    check_transform,
    invert_transform,
    make_transform,
    transform_points,
)
from robust6dof.tracking.motion import Motion, seconds_between
from robust6dof.tracking.region import cut_region, depth_noise
from robust6dof.tracking.support_plane import Plane, fit_plane, least_squares_plane


@dataclass(frozen=True)
class IcpConfig:
    """Lengths given as shares are multiplied by the diagonal of the object's box."""

    voxel_share: float = 0.025
    """Side of the model's voxels."""
    max_source_points: int = 600
    """Object points of one frame that are registered."""
    max_plane_points: int = 200
    """Points of the supporting plane that are registered with them."""
    max_model_points: int = 4000
    cutoff_shares: tuple[float, ...] = (0.25, 0.10, 0.05)
    """Largest correspondence distance, from coarse to fine."""
    search_share: float = 0.15
    """How far outside the predicted box points are still taken."""
    iterations: int = 10
    """Of each stage."""
    prior_rotation_deg: float = 4.0
    """Trust in the motion prediction per frame; decides only where geometry says little."""
    prior_translation_share: float = 0.15
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
    plane_tolerance: float = 0.012
    """The plane is let go when the object alone disagrees with it by more than this [m], …"""
    plane_tolerance_deg: float = 6.0
    """… or this."""
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
        """Begin from a pose, a mask or a box; see `PoseTracker.start`."""
        if T_cam_obj is None or extents is None:
            raise InputError("the ICP starts from T_cam_obj and extents")
        T_cam_obj = check_transform(T_cam_obj, "T_cam_obj")
        plane = self._find_plane(frame, T_cam_obj, extents)
        voxel = self.config.voxel_share * float(np.linalg.norm(extents))
        blank = SurfaceModel.empty(voxel, self.config.max_model_points)
        source = _cut(frame, T_cam_obj, extents, 0.02, plane, self.config)
        if source is None or len(source.points) < 20:
            raise InputError(
                "no depth on the object in the first frame: check the start pose, the depth's "
                "unit and that the object is in view"
            )
        surface = blank.merged(source.points, source.normals, _view_weight(T_cam_obj))
        memory = IcpMemory(
            surface=surface,
            target=RegistrationTarget.build(surface, plane, extents),
            plane=plane,
            keyframes=_view_of(T_cam_obj)[None],
            motion=Motion.at_rest(),
        )
        quality = self._assess(frame, T_cam_obj, surface)[0]
        return Track(
            T_cam_obj=T_cam_obj,
            extents=np.asarray(extents, dtype=np.float64),
            confidence=quality.confidence,
            state=TrackState.TRACKING,
            category=self.category,
            stamp=frame.stamp,
            memory=memory,
        )

    def step(self, track: Track, frame: RgbdFrame) -> Track:
        """Follow the object to `frame`; never raises on a bad image."""
        memory: IcpMemory = track.memory
        seconds = seconds_between(track.stamp, frame.stamp)
        T_predicted = memory.motion.predict(track.T_cam_obj, seconds)
        fit = self._fit(frame, T_predicted, track.extents, memory)
        if fit.quality.confidence < self.config.tracking_confidence:
            at_rest = self._fit(frame, track.T_cam_obj, track.extents, memory)
            if at_rest.quality.confidence > fit.quality.confidence:
                fit = at_rest
        return self._conclude(track, frame, fit, seconds)

    def _conclude(
        self,
        track: Track,
        frame: RgbdFrame,
        fit: _Fit,
        seconds: float,
    ) -> Track:
        config, memory, quality, T_new = self.config, track.memory, fit.quality, fit.T_cam_obj
        bad = quality.confidence < config.lost_confidence
        memory = replace(
            memory,
            frames=memory.frames + 1,
            bad_frames=memory.bad_frames + 1 if bad else 0,
            good_frames=memory.good_frames + 1
            if quality.confidence >= config.tracking_confidence
            else 0,
        )
        state = self._next_state(track.state, memory, quality)
        if bad:
            T_new = track.T_cam_obj
            memory = replace(memory, motion=Motion.at_rest())
        else:
            newest = Motion.between(track.T_cam_obj, T_new, seconds)
            memory = replace(memory, motion=memory.motion.blended(newest, 0.5))
            memory = self._watch_plane(memory, fit.plane_points, track.extents)
            if state is TrackState.TRACKING and quality.confidence >= config.growth_confidence:
                memory = self._learn(memory, frame, T_new, track.extents)
        return replace(
            track,
            T_cam_obj=T_new,
            confidence=quality.confidence,
            state=state,
            stamp=frame.stamp,
            memory=memory,
        )

    def _next_state(self, state: TrackState, memory: IcpMemory, quality: FitQuality) -> TrackState:
        config = self.config
        good = quality.confidence >= config.tracking_confidence
        if state in (TrackState.LOST, TrackState.RECOVERING):
            if good:
                settled = memory.good_frames >= config.lost_frames
                return TrackState.TRACKING if settled else TrackState.RECOVERING
            return TrackState.LOST
        if memory.bad_frames >= config.lost_frames or quality is NOTHING_SEEN:
            return TrackState.LOST
        return TrackState.TRACKING if good else TrackState.UNCERTAIN

    def _fit(
        self,
        frame: RgbdFrame,
        T_predicted: np.ndarray,
        extents: np.ndarray,
        memory: IcpMemory,
    ) -> _Fit:
        source = _cut(
            frame, T_predicted, extents, self.config.search_share, memory.plane, self.config
        )
        if source is None or len(source.points) < 20:
            return _Fit(T_predicted, NOTHING_SEEN, np.zeros((0, 3)))
        fit = self._register(source, memory.target, extents, T_predicted[2, 3])
        if fit is None:
            return _Fit(T_predicted, NOTHING_SEEN, np.zeros((0, 3)))
        T_new = _orthonormal(T_predicted @ invert_transform(fit.T_target_source))
        quality = self._assess(frame, T_new, memory.surface)[0]
        return _Fit(T_new, quality, transform_points(fit.T_target_source, source.plane_points))

    def _register(
        self,
        source: _Source,
        target: RegistrationTarget,
        extents: np.ndarray,
        distance: float,
    ) -> Registration | None:
        config = self.config
        scale = float(np.linalg.norm(extents))
        noise = float(depth_noise(distance))
        return register(
            np.concatenate([source.points, source.plane_points]),
            np.concatenate([source.normals, source.plane_normals]),
            target.points,
            target.normals,
            target.tree,
            cutoffs=[max(share * scale, 3.0 * noise) for share in config.cutoff_shares],
            noise=noise,
            prior=Prior(
                np.deg2rad(config.prior_rotation_deg), config.prior_translation_share * scale
            ),
            iterations=config.iterations,
        )

    def _assess(
        self, frame: RgbdFrame, T_cam_obj: np.ndarray, surface: SurfaceModel
    ) -> tuple[FitQuality, Bool[np.ndarray, "M"]]:
        return assess(frame, T_cam_obj, surface.points, surface.normals, spacing=surface.voxel)

    def _find_plane(
        self, frame: RgbdFrame, T_cam_obj: np.ndarray, extents: np.ndarray
    ) -> Plane | None:
        """The plane through the surroundings that touches the box from outside, if there is one."""
        scale = float(np.linalg.norm(extents))
        region = cut_region(frame, T_cam_obj, 2.2 * extents, max_points=3000)
        if region is None:
            return None
        points = transform_points(invert_transform(T_cam_obj), region.points_cam)
        near = np.linalg.norm(points, axis=-1) < 1.3 * scale
        outside = (np.abs(points) > 0.5 * extents).any(axis=-1)
        points = points[near & outside]
        camera = invert_transform(T_cam_obj)[:3, 3]
        found = fit_plane(
            points,
            np.random.default_rng(self._seed),
            tolerance=0.004 + float(depth_noise(T_cam_obj[2, 3])),
            viewpoint=camera,
        )
        if found is None or found[1].sum() < max(60, 0.25 * len(points)):
            return None
        plane = found[0]
        reach = 0.5 * float(np.abs(plane.normal) @ extents)
        touches = abs(plane.offset - reach) < 0.15 * scale
        return plane if touches else None

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
        off = tilt > config.plane_tolerance_deg or gap > config.plane_tolerance
        misses = memory.plane_misses + 1 if off else 0
        if misses < config.plane_patience:
            return replace(memory, plane_misses=misses)
        target = RegistrationTarget.build(memory.surface, None, extents)
        return replace(memory, plane=None, plane_misses=0, target=target)

    def _learn(
        self,
        memory: IcpMemory,
        frame: RgbdFrame,
        T_cam_obj: np.ndarray,
        extents: np.ndarray,
    ) -> IcpMemory:
        view = _view_of(T_cam_obj)
        settling = memory.frames <= self.config.settle_frames
        if not settling and not self._is_new_view(view, memory.keyframes):
            return memory
        source = _cut(frame, T_cam_obj, extents, 0.02, memory.plane, self.config)
        if source is None:
            return memory
        _, refuted = self._assess(frame, T_cam_obj, memory.surface)
        surface = memory.surface.carved(refuted).merged(
            source.points, source.normals, _view_weight(T_cam_obj)
        )
        return replace(
            memory,
            surface=surface,
            target=RegistrationTarget.build(surface, memory.plane, extents),
            keyframes=np.concatenate([memory.keyframes, view[None]]),
        )

    def _is_new_view(self, view: np.ndarray, keyframes: np.ndarray) -> bool:
        cosines = np.clip(keyframes[:, :3] @ view[:3], -1.0, 1.0)
        far = np.degrees(np.arccos(cosines)) > self.config.keyframe_angle_deg
        nearer = keyframes[:, 3] > self.config.keyframe_distance_ratio * view[3]
        return bool((far | nearer).all())


@dataclass(frozen=True, eq=False)
class _Fit:
    T_cam_obj: Float[np.ndarray, "4 4"]
    quality: FitQuality
    plane_points: Float[np.ndarray, "R 3"]
    """What was seen of the supporting plane, in the fitted object frame [m]."""


@dataclass(frozen=True, eq=False)
class _Source:
    """One frame's points in the predicted object frame."""

    points: Float[np.ndarray, "P 3"]
    normals: Float[np.ndarray, "P 3"]
    plane_points: Float[np.ndarray, "R 3"]
    plane_normals: Float[np.ndarray, "R 3"]


def _cut(
    frame: RgbdFrame,
    T_cam_obj: np.ndarray,
    extents: np.ndarray,
    margin_share: float,
    plane: Plane | None,
    config: IcpConfig,
) -> _Source | None:
    """What of the frame may be the object at `T_cam_obj`, and what the plane under it."""
    scale = float(np.linalg.norm(extents))
    reach = 2.0 * plane_radius(extents) if plane is not None else 0.0
    around = np.maximum(extents + 2 * margin_share * scale, reach)
    region = cut_region(frame, T_cam_obj, around, max_points=6000)
    if region is None or len(region.points_cam) < 20:
        return None
    points = transform_points(invert_transform(T_cam_obj), region.points_cam)
    inside = (np.abs(points) < 0.5 * extents + margin_share * scale).all(axis=-1)
    plane_points = np.zeros((0, 3))
    if plane is not None:
        height = plane.height(points)
        above = height > 0.003 + 1.5 * float(depth_noise(T_cam_obj[2, 3]))
        ring = ~inside & (np.abs(height) < 0.02 + 2.0 * float(depth_noise(T_cam_obj[2, 3])))
        ring &= np.linalg.norm(points, axis=-1) < plane_radius(extents)
        plane_points = _thinned(points[ring], config.max_plane_points)
        inside &= above
    inside_points = points[inside]
    plane_normals = np.zeros((len(plane_points), 3))
    if plane is not None:
        plane_normals += plane.normal
    if len(inside_points) < 20:
        return _Source(np.zeros((0, 3)), np.zeros((0, 3)), plane_points, plane_normals)
    camera = invert_transform(T_cam_obj)[:3, 3]
    kept, normals = _with_normals(inside_points, camera, config, scale)
    return _Source(kept, normals, plane_points, plane_normals)


def _with_normals(
    points: np.ndarray, camera: np.ndarray, config: IcpConfig, scale: float
) -> tuple[np.ndarray, np.ndarray]:
    """Voxel-thin, estimate normals towards the camera, drop grazing and isolated points."""
    cloud = small_gicp.voxelgrid_sampling(points, config.voxel_share * scale)
    if cloud.size() < 20:
        return np.zeros((0, 3)), np.zeros((0, 3))
    small_gicp.estimate_normals_covariances(cloud, small_gicp.KdTree(cloud), 10)
    thinned, normals = np.asarray(cloud.points())[:, :3], np.asarray(cloud.normals())[:, :3]
    towards = camera - thinned
    cosine = np.sum(normals * towards, axis=-1) / np.linalg.norm(towards, axis=-1)
    normals = np.where(cosine[:, None] < 0, -normals, normals)
    usable = np.abs(cosine) > 0.2
    keep = np.nonzero(usable)[0]
    keep = keep[:: max(1, int(np.ceil(len(keep) / config.max_source_points)))]
    return thinned[keep], normals[keep]


def _thinned(points: np.ndarray, count: int) -> np.ndarray:
    return points[:: max(1, int(np.ceil(len(points) / count)))]


def _view_weight(T_cam_obj: np.ndarray) -> float:
    """Of a view's points: the inverse variance of their depth, 1 where it is under a millimetre."""
    return float(1e-6 / (1e-6 + depth_noise(T_cam_obj[2, 3]) ** 2))


def _view_of(T_cam_obj: np.ndarray) -> Float[np.ndarray, "4"]:
    """Direction to the camera in the object frame, and its distance [m]."""
    camera = invert_transform(T_cam_obj)[:3, 3]
    distance = float(np.linalg.norm(camera))
    return np.append(camera / max(distance, 1e-9), distance)


def _orthonormal(T: np.ndarray) -> Float[np.ndarray, "4 4"]:
    U, _, Vt = np.linalg.svd(T[:3, :3])
    return make_transform(U @ Vt, T[:3, 3])
