"""Features and depth: what a good engineer builds in a week, in the spirit of BundleTrack.

SIFT with depth is matched against the last frame and the stored views whose viewpoint is nearest;
RANSAC and a rigid fit over all pairs at once give a pose in the first frame's object frame, so that
nothing is chained; dense registration to the same stored views settles what few features leave
open. No weights, no model of the object.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import reduce

import numpy as np
from jaxtyping import Bool, Float

from robust6dof.baselines.feature_memory import (
    LEARNING_MARGIN,
    FeatureMemory,
    StoredView,
    store_view,
)
from robust6dof.baselines.feature_view import find_features
from robust6dof.errors import InputError
from robust6dof.frames import Box, RgbdFrame, Track, TrackState
from robust6dof.geometry.transforms import check_transform, invert_transform
from robust6dof.solver.rigid_ransac import ransac_rigid
from robust6dof.tracking.image_features import FeatureConfig, Features, match
from robust6dof.tracking.initialisation import NOTHING_THERE, find_initial_pose
from robust6dof.tracking.motion import Motion, seconds_between
from robust6dof.tracking.region import depth_noise
from robust6dof.tracking.states import StateCount, StateRules, next_state
from robust6dof.tracking.support_plane import Plane, find_support_plane
from robust6dof.tracking.surface.cloud import Cloud
from robust6dof.tracking.surface.fit_quality import NOTHING_SEEN, FitQuality, assess
from robust6dof.tracking.surface.frame_cut import CutConfig, cut_frame
from robust6dof.tracking.surface.registration import Evidence, Stage, independent, register


@dataclass(frozen=True)
class FeatureTrackerConfig:
    """Shares are of the diagonal of the object's box."""

    features: FeatureConfig = field(default_factory=FeatureConfig)
    cut: CutConfig = field(default_factory=CutConfig)
    states: StateRules = field(default_factory=StateRules)
    search_share: float = 0.2
    """How far outside the predicted box features are still taken."""
    inlier_share: float = 0.03
    """A pair agrees with a pose within this, or twice the depth's noise."""
    least_inliers: int = 6
    """Pairs that must agree, or the features say nothing."""
    sure_inliers: int = 20
    """With fewer the predicted pose is tried too, and the better one by depth is taken."""
    matched_views: int = 3
    """Stored views matched, beside the last frame."""
    capacity: int = 16
    """Stored views at most; the first one stays."""
    spacing_deg: float = 12.0
    """Angle between the viewpoints of stored views, at least."""
    motion_rad: float = 0.03
    """Doubt [rad] in a pose that only the motion predicts, …"""
    motion_m: float = 0.008
    """… and [m]; four times as much in the first frames."""
    voxel_share: float = 0.025
    """Side of the voxels that thin the dense clouds."""
    cutoff_shares: tuple[float, float] = (0.1, 0.05)
    """Largest distance between partners in the dense registration, coarse and fine."""
    store_confidence: float = 0.7
    """Views are stored from this confidence on."""


@dataclass(frozen=True, eq=False)
class _Estimate:
    T_cam_obj: Float[np.ndarray, "4 4"]
    inliers: int
    features: Features
    """Of the frame, in the camera's frame."""
    quality: FitQuality = NOTHING_SEEN
    cloud: Cloud | None = None
    """Of the frame, in the object's frame."""

    @property
    def confidence(self) -> float:
        """The dense evidence, helped on by many agreeing features."""
        by_features = min(1.0, self.inliers / 30.0)
        return max(self.quality.confidence, by_features * self.quality.agreement)


class FeatureTracker:
    """SIFT, depth, RANSAC and stored views behind the `PoseTracker` protocol."""

    def __init__(
        self,
        category: str = "object",
        config: FeatureTrackerConfig | None = None,
        *,
        seed: int = 0,
    ) -> None:
        self.category = category
        self.config = config or FeatureTrackerConfig()
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
        T_start, extents = initial.T_cam_obj, initial.extents
        plane = find_support_plane(frame, T_start, extents, np.random.default_rng(self._seed))
        margin = LEARNING_MARGIN * float(np.linalg.norm(extents))
        features = find_features(
            frame, T_start, extents, plane, margin, self.config.features, initial.mask
        )
        cloud = self._cut(frame, T_start, extents, plane, margin, initial.mask)
        if not len(cloud):
            raise InputError(NOTHING_THERE)
        view = store_view(features, cloud, T_start, extents)
        memory = FeatureMemory(view, (view,), plane, Motion.at_rest(), StateCount())
        return Track(
            T_cam_obj=T_start,
            extents=extents,
            confidence=1.0,
            state=TrackState.TRACKING,
            category=self.category,
            stamp=frame.stamp,
            memory=memory,
        )

    def step(self, track: Track, frame: RgbdFrame) -> Track:
        """Follow the object to `frame`; never raises on a bad image."""
        memory: FeatureMemory = track.memory
        seconds = seconds_between(track.stamp, frame.stamp)
        T_predicted = memory.motion.predict(track.T_cam_obj, seconds)
        estimate = self._estimate(frame, T_predicted, track)
        count = memory.count.after(estimate.confidence, self.config.states)
        lost = estimate.confidence < self.config.states.lost
        T_cam_obj = track.T_cam_obj if lost else estimate.T_cam_obj
        newest = Motion.between(track.T_cam_obj, T_cam_obj, seconds)
        motion = Motion.at_rest() if lost else memory.motion.blended(newest, 0.5)
        memory = replace(memory, motion=motion, count=count, frames=memory.frames + 1)
        return replace(
            track,
            T_cam_obj=T_cam_obj,
            confidence=estimate.confidence,
            state=next_state(track.state, count, self.config.states),
            stamp=frame.stamp,
            memory=memory if lost else self._remembered(memory, estimate, track.extents),
        )

    def _estimate(self, frame: RgbdFrame, T_predicted: np.ndarray, track: Track) -> _Estimate:
        memory: FeatureMemory = track.memory
        margin = self.config.search_share * track.scale
        features = find_features(
            frame, T_predicted, track.extents, memory.plane, margin, self.config.features
        )
        views = memory.nearest(T_predicted, self.config.matched_views)
        T_feat, inliers = self._from_features(features, views, T_predicted, track)
        starts = [_Estimate(T_feat, inliers, features)] if inliers else []
        if inliers < self.config.sure_inliers:
            starts.append(_Estimate(T_predicted, 0, features))
        refined = [self._refined(frame, start, views[1:], track) for start in starts]
        return max(refined, key=lambda estimate: estimate.confidence)

    def _from_features(
        self, features: Features, views: Sequence[StoredView], T_predicted: np.ndarray, track: Track
    ) -> tuple[np.ndarray, int]:
        """The pose that most pairs with all views agree on, or the predicted one."""
        pairs = [
            (view, match(view.features, features, self.config.features.ratio)) for view in views
        ]
        points_obj = np.concatenate([view.features.points[ij[:, 0]] for view, ij in pairs])
        points_cam = np.concatenate([features.points[ij[:, 1]] for _, ij in pairs])
        if len(points_obj) < self.config.least_inliers:
            return T_predicted, 0
        distance = self._inlier_distance(track)
        rng = np.random.default_rng([self._seed, track.memory.frames])
        fit = ransac_rigid(points_obj, points_cam, None, distance, rng, hypotheses=256)
        inliers = int(fit.inliers.sum())
        if inliers < self.config.least_inliers:
            return T_predicted, 0
        return fit.T_dst_src, inliers

    def _inlier_distance(self, track: Track) -> float:
        noise = float(depth_noise(track.T_cam_obj[2, 3]))
        return max(self.config.inlier_share * track.scale, 2.0 * noise)

    def _refined(
        self, frame: RgbdFrame, estimate: _Estimate, views: Sequence[StoredView], track: Track
    ) -> _Estimate:
        """Dense registration about the features' pose, which holds it the more they are."""
        T_start, scale = estimate.T_cam_obj, track.scale
        margin = 0.5 * self.config.search_share * scale
        cloud = self._cut(frame, T_start, track.extents, track.memory.plane, margin)
        if not len(cloud):
            return estimate
        noise = float(depth_noise(T_start[2, 3]))
        evidence = [Evidence(cloud, view.surface, noise) for view in views]
        fit = register(evidence, self._stages(scale, noise), self._hold(estimate.inliers, track))
        T_obj_start = np.eye(4) if fit is None else fit.T_target_source
        T_cam_obj = check_transform(T_start @ invert_transform(T_obj_start))
        quality = _assess(frame, T_cam_obj, views, self._voxel(scale))
        cloud = cloud.moved(T_obj_start)
        return replace(estimate, T_cam_obj=T_cam_obj, quality=quality, cloud=cloud)

    def _hold(self, inliers: int, track: Track) -> Float[np.ndarray, "6 6"]:
        """Information about the pose before registration: of the features, else of the motion."""
        if inliers:
            sigma = 3.0 * self._inlier_distance(track) / np.sqrt(inliers)
            return independent(4.0 * sigma / track.scale, sigma)
        unsettled = 4.0 if track.memory.frames < 4 else 1.0
        return independent(unsettled * self.config.motion_rad, unsettled * self.config.motion_m)

    def _stages(self, scale: float, noise: float) -> list[Stage]:
        coarse, fine = (max(share * scale, 3.0 * noise) for share in self.config.cutoff_shares)
        return [Stage(coarse, 5, 2, small_m=4e-4, small_rad=2e-3), Stage(fine, 6)]

    def _voxel(self, scale: float) -> float:
        return float(np.clip(self.config.voxel_share * scale, 0.0025, 0.008))

    def _cut(
        self,
        frame: RgbdFrame,
        T_cam_obj: np.ndarray,
        extents: np.ndarray,
        plane: Plane | None,
        margin: float,
        mask: np.ndarray | None = None,
    ) -> Cloud:
        voxel = self._voxel(float(np.linalg.norm(extents)))
        return cut_frame(
            frame,
            T_cam_obj,
            extents,
            plane,
            margin=margin,
            voxel=voxel,
            config=self.config.cut,
            mask=mask,
        )

    def _remembered(
        self, memory: FeatureMemory, estimate: _Estimate, extents: np.ndarray
    ) -> FeatureMemory:
        """The frame becomes the last view; a stored one too, where it is new and trusted."""
        if estimate.cloud is None:
            return memory
        view = store_view(estimate.features, estimate.cloud, estimate.T_cam_obj, extents)
        memory = replace(memory, last=view)
        if estimate.confidence < self.config.store_confidence:
            return memory
        spacing = np.radians(self.config.spacing_deg)
        return memory.with_view(view, spacing, self.config.capacity)


def _assess(
    frame: RgbdFrame, T_cam_obj: np.ndarray, views: Sequence[StoredView], spacing: float
) -> FitQuality:
    """How far the frame's depth agrees with the stored views at this pose."""
    cloud = reduce(Cloud.joined, [view.surface.cloud for view in views])
    return assess(frame, T_cam_obj, cloud, spacing=spacing)[0]
