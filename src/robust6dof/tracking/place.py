"""Where an object that is out of sight should be, by what stands around it.

While the object is tracked, some frames are kept as they are. Once it is lost, the features of
these whole images are matched with the new frame's (PnP and RANSAC): the place where it stood is
followed while the camera looks elsewhere, and recognised when it looks back. How far from there
the object may be grows with the time; fast if it was moving, or once its place has been in view
without it.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import combinations

import numpy as np
from jaxtyping import Float

from robust6dof.frames import RgbdFrame
from robust6dof.geometry.camera import project
from robust6dof.geometry.transforms import orientation_error, transform_points
from robust6dof.solver.pnp import ransac_pnp
from robust6dof.tracking.image_features import FeatureConfig, Features, detect_features, match


@dataclass(frozen=True)
class PlaceConfig:
    """How the place of a lost object is remembered."""

    features: FeatureConfig = field(default_factory=lambda: FeatureConfig(most=400, ratio=0.8))
    least_inliers: int = 12
    """Matches that agree, or the surroundings are not recognised."""
    inlier_px: float = 3.0
    inlier_m: float = 0.1
    """A match agrees within both: few in a repeated pattern do in depth, too."""
    kept_every: int = 10
    """One in so many frames is kept besides the last, …"""
    kept: int = 3
    """… the newest of these."""
    moved_m: float = 0.03
    """An object that came so far among its surroundings between two sights was moving."""
    reach_m: float = 0.1
    """An object that stood still is looked for within this of its place, …"""
    speed: float = 0.3
    """… and farther by this as time goes by [m/s]; …"""
    moving_speed: float = 0.5
    """… by this if it was moving, or has been moved."""
    reach_rad: float = np.deg2rad(30.0)
    """It has not turned by more than this, …"""
    turning: float = np.deg2rad(40.0)
    """… and as time goes by this [rad/s]; …"""
    moving_turning: float = np.deg2rad(60.0)
    """… this if it was moving, or has been moved."""
    stood_m: float = 0.15
    """What is found so near its place, …"""
    stood_rad: float = np.deg2rad(30.0)
    """… and turned by no more, stands where it stood."""
    looked_s: float = 0.3
    """After its place was in view for longer and it was not found there, it has been moved."""
    glance_s: float = 0.1
    """One image shows its place for no longer than this, however late it comes."""
    patience_s: float = 0.5
    """Where it is not known for longer, the object is looked for everywhere."""


@dataclass(frozen=True, eq=False)
class WholeView:
    """A frame and the features of its whole image, which are found when they are needed."""

    frame: RgbdFrame
    config: FeatureConfig

    @cached_property
    def features(self) -> Features:
        rectangle = (0, 0, self.frame.width, self.frame.height)
        return detect_features(self.frame, rectangle, self.config)


@dataclass(frozen=True, eq=False)
class SeenPlace:
    """A past view and where the object was, or should have been, in it."""

    view: WholeView
    T_cam_obj: Float[np.ndarray, "4 4"]

    def recognised_in(self, view: WholeView, config: PlaceConfig) -> SeenPlace | None:
        """`view`, and where the object should be in it, if it stood still; None where too few of
        the features agree."""
        past, features = self.view.features, view.features
        pairs = match(past, features, config.features.ratio)
        if len(pairs) < config.least_inliers:
            return None
        old, new = pairs.T
        pixels = features.pixels[new].astype(float)
        fit = ransac_pnp(past.points[old], pixels, view.frame.K, config.inlier_px)
        if fit is None:
            return None
        moved = transform_points(fit.T_dst_src, past.points[old])
        apart = np.linalg.norm(moved - features.points[new], axis=-1)
        if (fit.inliers & (apart < config.inlier_m)).sum() < config.least_inliers:
            return None
        return SeenPlace(view, fit.T_dst_src @ self.T_cam_obj)


@dataclass(frozen=True, eq=False)
class PlaceMemory:
    """Immutable; each frame makes a new one."""

    seen: tuple[SeenPlace, ...] = ()
    """Frames with the object, the newest last."""
    followed: SeenPlace | None = None
    """The newest frame since then whose surroundings were recognised."""
    T_cam_obj: Float[np.ndarray, "4 4"] | None = None
    """Where the lost object should be in the newest frame; None where that is not known."""
    T_cam_other: Float[np.ndarray, "4 4"] | None = None
    """Where else: a followed place drifts, and in a pattern that repeats itself places look alike,
    so a sight of the object may say otherwise."""
    moving: bool = False
    """Whether it moved among its surroundings when it was last seen."""
    looked_s: float = 0.0
    """For how long its place has been in view without it since then."""
    seconds: float = 0.0
    """Since it was last seen."""
    unknown_s: float = 0.0
    """Since its place was last known."""
    frames: int = 0
    """In which it was seen without a break."""

    def after_sight(
        self,
        frame: RgbdFrame,
        T_cam_obj: Float[np.ndarray, "4 4"],
        moving: bool,
        config: PlaceConfig,
    ) -> PlaceMemory:
        """The object is seen in `frame`."""
        keeps_last = self.frames % config.kept_every == 0
        kept = self.seen if keeps_last else self.seen[:-1]
        seen = (*kept[-config.kept :], SeenPlace(WholeView(frame, config.features), T_cam_obj))
        return PlaceMemory(seen, moving=moving, frames=self.frames + 1)

    def after_loss(self, frame: RgbdFrame, seconds: float, config: PlaceConfig) -> PlaceMemory:
        """The object is lost or in doubt, `seconds` after the frame before: follow its place."""
        moving = self.moving or (self.frames > 0 and self._has_moved(config))
        memory = replace(self, seconds=self.seconds + seconds, frames=0, moving=moving)
        here, other = self._recognised(WholeView(frame, config.features), config)
        T_cam_other = None if other is None else other.T_cam_obj
        if here is not None:
            memory = replace(memory, followed=here, T_cam_obj=here.T_cam_obj, unknown_s=0.0)
            return replace(memory, T_cam_other=T_cam_other)
        unknown_s = self.unknown_s + seconds if frame.has_color else np.inf
        return replace(memory, T_cam_obj=None, T_cam_other=None, unknown_s=unknown_s)

    def _has_moved(self, config: PlaceConfig) -> bool:
        """By the two sights farthest apart of which one shows what stood around the object in the
        other: the last ones may be blurred."""
        pairs = combinations(range(len(self.seen)), 2)
        for old, new in sorted(pairs, key=lambda pair: pair[0] - pair[1]):
            stood = self.seen[old].recognised_in(self.seen[new].view, config)
            if stood is not None:
                return _distance(stood, self.seen[new]) > config.moved_m
        return False

    def _recognised(
        self, view: WholeView, config: PlaceConfig
    ) -> tuple[SeenPlace | None, SeenPlace | None]:
        """From the frame before, whose drift the newest sight that is recognised mends; both where
        they differ."""
        followed = self.followed and self.followed.recognised_in(view, config)
        sights = (past.recognised_in(view, config) for past in reversed(self.seen))
        mended = next((one for one in sights if one is not None), None)
        if followed is None or mended is None:
            return followed or mended, None
        if _distance(mended, followed) > config.inlier_m:
            return followed, mended
        return mended, None

    def in_view_without(self, seconds: float, config: PlaceConfig) -> PlaceMemory:
        """The newest frame shows the place, empty, and `seconds` have gone by since the one before.
        Of two places neither counts."""
        if self.T_cam_other is not None:
            return self
        return replace(self, looked_s=self.looked_s + min(seconds, config.glance_s))

    def surprise(
        self, T_cam_obj: Float[np.ndarray, "4 4"], symmetric: bool, config: PlaceConfig
    ) -> float:
        """Minus the log likelihood of the object being here by now, its reach being two standard
        deviations; infinite beyond it, and 0 where its place is not known.

        Args:
            T_cam_obj: of the same frame as those that were remembered.
            symmetric: its turn about y says nothing.
            config: how fast it may have moved.
        """
        free = self._is_free(config)
        turning = config.moving_turning if free else config.turning
        reach = np.array([self._reach(config), config.reach_rad + turning * self.seconds])
        shares = [apart / reach for apart in self._apart(T_cam_obj, symmetric)]
        surprises = [2.0 * share @ share if max(share) < 1.0 else np.inf for share in shares]
        return float(min(surprises, default=0.0))

    def confirms(
        self, T_cam_obj: Float[np.ndarray, "4 4"], symmetric: bool, config: PlaceConfig
    ) -> bool:
        """Whether the object stood still and is where it stood."""
        limit = np.array([config.stood_m, config.stood_rad])
        near = any((apart < limit).all() for apart in self._apart(T_cam_obj, symmetric))
        return near and not self._is_free(config)

    @property
    def known(self) -> list[Float[np.ndarray, "4 4"]]:
        """Where the lost object should be in the newest frame: one place, two or none."""
        return [T for T in (self.T_cam_obj, self.T_cam_other) if T is not None]

    def _apart(self, T_cam_obj: np.ndarray, symmetric: bool) -> list[Float[np.ndarray, "2"]]:
        """Distance [m] and turn [rad] from the place, and from the other; none where not known."""
        return [
            np.array(
                [
                    np.linalg.norm(T_cam_obj[:3, 3] - T[:3, 3]),
                    orientation_error(T_cam_obj[:3, :3], T[:3, :3], symmetric),
                ]
            )
            for T in self.known
        ]

    def worth_a_search(self, frame: RgbdFrame, config: PlaceConfig) -> bool:
        """Whether the object may be in view; not while the image is too blurred to say."""
        if not self.known:
            return self.unknown_s >= config.patience_s
        reach = self._reach(config)
        return any(_may_show(frame, T_cam_obj[:3, 3], reach) for T_cam_obj in self.known)

    def _reach(self, config: PlaceConfig) -> float:
        """How far from its place the object may be [m]."""
        speed = config.moving_speed if self._is_free(config) else config.speed
        return config.reach_m + speed * self.seconds

    def _is_free(self, config: PlaceConfig) -> bool:
        """Whether it moved, or has been moved: it is not where it stood."""
        return self.moving or self.looked_s > config.looked_s


def _may_show(frame: RgbdFrame, centre: Float[np.ndarray, "3"], reach: float) -> bool:
    """Whether the image may show something within `reach` [m] of a point in camera axes."""
    if centre[2] < reach:
        return bool(centre[2] > -reach)
    (pixel,) = project(centre[None], frame.K)
    margin = reach * frame.K[0, 0] / centre[2]
    return bool((pixel > -margin).all() and (pixel < [frame.width, frame.height] + margin).all())


def _distance(a: SeenPlace, b: SeenPlace) -> float:
    return float(np.linalg.norm(a.T_cam_obj[:3, 3] - b.T_cam_obj[:3, 3]))
