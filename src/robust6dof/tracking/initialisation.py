"""The first pose: from a mask, a box, a click, or nothing but the category.

The category's prior is fitted to the object's points and outline, from many starts: its up axis
along the normal of the plane that the object stands on, every yaw, height and width free about
each other. The fit gives pose, metric scale and extents at once.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import least_squares
from scipy.spatial import KDTree

from robust6dof.errors import InputError
from robust6dof.frames import SYMMETRIC_CATEGORIES, Box, RgbdFrame
from robust6dof.geometry.camera import backproject
from robust6dof.geometry.transforms import (
    check_transform,
    invert_transform,
    make_transform,
    rotation_about_y,
    transform_points,
)
from robust6dof.shapes.priors import load_prior
from robust6dof.tracking.region import depth_noise
from robust6dof.tracking.segmentation import (
    DepthClusters,
    GivenMask,
    Segment,
    Segmenter,
    connected_pieces,
    local_plane,
    plane_height,
    propagated_mask,
    segment_box,
    segment_click,
    valid_depth,
)
from robust6dof.tracking.support_plane import Plane

DIAGONAL_RANGE_M: dict[str, tuple[float, float]] = {
    "bottle": (0.12, 0.40),
    "bowl": (0.10, 0.35),
    "camera": (0.08, 0.30),
    "can": (0.08, 0.25),
    "laptop": (0.30, 0.70),
    "mug": (0.09, 0.25),
}
"""Diagonal of the box of everyday objects; a fit outside is a poor one."""

_LEAST_POINTS = 30


@dataclass(frozen=True)
class InitialisationConfig:
    """How the prior is fitted."""

    yaw_starts: int = 12
    """Turns about the up axis that are tried (one for a symmetric category)."""
    fine_starts: int = 4
    """The best of them are refined with more points."""
    coarse_points: int = 80
    fine_points: int = 400
    """Observed points that are compared; the prior has three times as many."""
    width_doubt: float = 0.15
    """Standard deviation of log(width / height) about the prior's …"""
    laptop_width_doubt: float = 0.5
    """… and for a laptop, whose height depends on how far it is open."""
    candidates: int = 4
    """Pieces that are tried where nothing is marked."""
    seed: int = 0


@dataclass(frozen=True, eq=False)
class InitialPose:
    """Where the object is, and how large."""

    T_cam_obj: Float[np.ndarray, "4 4"]
    extents: Float[np.ndarray, "3"]
    """[m]"""
    cost: float
    """Mean robust distance of the fit over the noise; 0 for a given pose. Less is better."""
    mask: Bool[np.ndarray, "H W"] | None = None
    """The pixels it was fitted to."""


def find_initial_pose(
    frame: RgbdFrame,
    category: str,
    *,
    mask: Bool[np.ndarray, "H W"] | None = None,
    box: Box | None = None,
    click: tuple[float, float] | None = None,
    T_cam_obj: Float[np.ndarray, "4 4"] | None = None,
    extents: Float[np.ndarray, "3"] | None = None,
    prior: Float[np.ndarray, "N 3"] | None = None,
    segmenter: Segmenter | None = None,
    config: InitialisationConfig | None = None,
) -> InitialPose:
    """Pose and size of the object in the first frame, from whatever is known.

    A given pose is taken as it is; extents are estimated where they are not given. Without any
    hint, pieces that stand on a plane are tried and the one that fits the category best is taken.

    Args:
        prior: points of the category's mean shape (canonical axes, diagonal 1); by default the
            shipped one.
        segmenter: finds pieces where there is neither mask nor box; by default `DepthClusters`.

    Raises:
        InputError: an empty or misfitting mask, a box or click outside the image, no valid depth
            on the object, nothing found, extents that are not positive.
    """
    config = config or InitialisationConfig()
    extents = None if extents is None else _check_extents(extents)
    if T_cam_obj is not None:
        T_cam_obj = check_transform(T_cam_obj, "T_cam_obj")
        if extents is not None:
            return InitialPose(T_cam_obj, extents, 0.0, mask)
    shape = _unit(load_prior(category) if prior is None else prior)
    fitter = _PriorFit(frame, category, shape, extents, config)
    if T_cam_obj is not None:
        return fitter.extents_at(T_cam_obj, _mask_at(frame, T_cam_obj, category, mask))
    segments = _segments(frame, mask, box, click, segmenter)
    fits = [fitter.fit(segment) for segment in segments[: config.candidates]]
    found = [fit for fit in fits if fit is not None]
    if not found:
        raise InputError(
            f"fewer than {_LEAST_POINTS} valid depth pixels on the object; start on a frame where "
            "the depth camera sees it, or give a pose"
        )
    return min(found, key=lambda fit: fit.cost)


def _segments(
    frame: RgbdFrame,
    mask: np.ndarray | None,
    box: Box | None,
    click: tuple[float, float] | None,
    segmenter: Segmenter | None,
) -> list[Segment]:
    if mask is not None:
        return GivenMask(mask).segment(frame)
    if box is not None:
        return [segment_box(frame, box)]
    if click is not None:
        return [segment_click(frame, *click, segmenter)]
    pieces = (segmenter or DepthClusters()).segment(frame)
    if not pieces:
        raise InputError(
            "nothing that stands clear of a supporting plane was found; give a mask, a box, a "
            "click or a pose"
        )
    return pieces


def _mask_at(
    frame: RgbdFrame, T_cam_obj: np.ndarray, category: str, mask: np.ndarray | None
) -> Bool[np.ndarray, "H W"]:
    """The pixels around a given pose's centre, no wider than the category's largest objects."""
    if mask is not None:
        return GivenMask(mask).segment(frame)[0].mask
    largest = DIAGONAL_RANGE_M.get(category, (0.05, 0.4))[1]
    around = propagated_mask(frame, T_cam_obj, np.full(3, 0.8 * largest))
    if not around.any():
        raise InputError("there is no valid depth around the start pose; check it and its unit")
    plane = local_plane(frame, around, is_object=False)
    if plane is not None:
        height = plane_height(frame, plane)
        around &= height > 0.004 + 2.0 * depth_noise(frame.depth)
    labels = connected_pieces(frame, around, 0.02)
    counts = np.bincount(labels.ravel())
    counts[0] = 0
    y, x = np.nonzero(labels)
    if not len(x):
        raise InputError("nothing stands clear of its support at the start pose; give the extents")
    points, _ = backproject(frame.depth, frame.K, labels > 0)
    away = np.linalg.norm(points - T_cam_obj[:3, 3], axis=-1)
    nearest = labels[y, x][np.argsort(away)[: max(20, len(away) // 20)]]
    return labels == np.bincount(nearest).argmax()


def _unit(points: np.ndarray) -> Float[np.ndarray, "N 3"]:
    """Centred on the box, diagonal 1."""
    points = np.asarray(points, dtype=np.float64)
    low, high = points.min(axis=0), points.max(axis=0)
    return (points - (low + high) / 2) / np.linalg.norm(high - low)


def _check_extents(extents: np.ndarray) -> Float[np.ndarray, "3"]:
    extents = np.asarray(extents, dtype=np.float64)
    if extents.shape != (3,) or not np.isfinite(extents).all() or (extents <= 0).any():
        raise InputError(
            f"extents must be three positive side lengths in metres, got {extents.tolist()}"
        )
    return extents


@dataclass(frozen=True, eq=False)
class _Evidence:
    """What the first frame shows of the object."""

    points_cam: Float[np.ndarray, "P 3"]
    noise: float
    """Expected depth error [m]."""
    outside_px: Float[np.ndarray, "H W"]
    """Distance of each pixel from the mask; 0 where something nearer may hide the object."""
    contour: Float[np.ndarray, "C 2"]
    """Pixels (x, y) on the mask's edge: thin parts (a handle) show here best."""
    frame: RgbdFrame
    plane: Plane | None


class _PriorFit:
    """Fits the prior to one segment after the other."""

    def __init__(
        self,
        frame: RgbdFrame,
        category: str,
        shape: Float[np.ndarray, "N 3"],
        extents: Float[np.ndarray, "3"] | None,
        config: InitialisationConfig,
    ) -> None:
        self._frame, self._category, self._config = frame, category, config
        self._shape, self._extents = shape, extents
        self._sides = np.ptp(shape, axis=0)
        self._rng = np.random.default_rng(config.seed)

    def fit(self, segment: Segment) -> InitialPose | None:
        """The best pose for a segment; None with too little depth in it."""
        evidence = self._evidence(segment)
        if evidence is None:
            return None
        rough = [
            self._refine(evidence, start, self._config.coarse_points)
            for up in self._ups(evidence)
            for start in self._starts(evidence, up)
        ]
        rough.sort(key=lambda fit: fit.cost)
        fine = [
            self._refine(evidence, fit, self._config.fine_points)
            for fit in rough[: self._config.fine_starts]
        ]
        best = min(fine, key=lambda fit: fit.cost)
        return replace(best, mask=segment.mask, cost=best.cost + self._implausible(best.extents))

    def extents_at(self, T_cam_obj: np.ndarray, mask: np.ndarray) -> InitialPose:
        """The extents at a given pose.

        Raises:
            InputError: too little depth on the object.
        """
        evidence = self._evidence(Segment(mask))
        if evidence is None:
            raise InputError("too little valid depth at the start pose; check it and its unit")
        points = transform_points(invert_transform(T_cam_obj), evidence.points_cam)
        reach = 2.0 * np.percentile(np.abs(points), 95, axis=0)
        start = InitialPose(T_cam_obj, np.maximum(reach, 0.02), np.inf, mask)
        fitted = self._refine(evidence, start, self._config.fine_points, move=False)
        return replace(fitted, T_cam_obj=T_cam_obj, mask=mask)

    def _evidence(self, segment: Segment) -> _Evidence | None:
        frame = self._frame
        solid = cv2.erode(segment.mask.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
        usable = solid if (solid & valid_depth(frame)).sum() > 200 else segment.mask
        points, _ = backproject(frame.depth, frame.K, usable & valid_depth(frame))
        points = _main_body(points)
        if len(points) < _LEAST_POINTS:
            return None
        distance = float(np.median(points[:, 2]))
        nearer = valid_depth(frame) & (frame.depth < distance - 0.02) & ~segment.mask
        free = (~segment.mask & ~nearer).astype(np.uint8)
        plane = segment.plane or local_plane(frame, segment.mask, self._config.seed)
        return _Evidence(
            points,
            0.002 + float(depth_noise(distance)),
            cv2.distanceTransform(free, cv2.DIST_L2, 3).astype(np.float64),
            _contour(segment.mask),
            frame,
            plane,
        )

    def _ups(self, evidence: _Evidence) -> list[Float[np.ndarray, "3"]]:
        """Up directions in the camera frame: the plane's normal, else some that are usual."""
        if evidence.plane is not None:
            return [evidence.plane.normal]
        tilts = np.deg2rad([10.0, 35.0, 60.0])
        return [np.array([0.0, -np.cos(tilt), -np.sin(tilt)]) for tilt in tilts]

    def _starts(self, evidence: _Evidence, up: Float[np.ndarray, "3"]) -> list[InitialPose]:
        points = evidence.points_cam
        height = points @ up
        top = float(np.percentile(height, 98))
        bottom = float(np.percentile(height, 2))
        if evidence.plane is not None:
            bottom = -evidence.plane.offset
        extents = self._extents
        if extents is None:
            extents = self._start_extents(points, up, max(top - bottom, 0.01))
        middle = np.median(points, axis=0)
        away = middle / np.linalg.norm(middle)
        centre = middle + 0.25 * float(np.hypot(extents[0], extents[2])) * _across(away, up)
        centre = centre + up * (0.5 * (top + bottom) - float(centre @ up))
        x_axis = _across(np.array([1.0, 0.0, 0.0]), up)
        x_axis /= max(float(np.linalg.norm(x_axis)), 1e-9)
        R_level = np.stack([x_axis, up, np.cross(x_axis, up)], axis=1)
        count = 1 if self._category in SYMMETRIC_CATEGORIES else self._config.yaw_starts
        return [
            InitialPose(
                make_transform(R_level @ rotation_about_y(2 * np.pi * turn / count), centre),
                extents,
                np.inf,
            )
            for turn in range(count)
        ]

    def _start_extents(
        self, points: np.ndarray, up: np.ndarray, height: float
    ) -> Float[np.ndarray, "3"]:
        """The prior's sides at the height that is seen; a laptop's at the width that is seen."""
        extents = self._sides / self._sides[1] * height
        if self._category != "laptop":
            return extents
        flat = points - np.outer(points @ up, up)
        away = np.linalg.norm(flat - np.median(flat, axis=0), axis=-1)
        seen = 2.0 * float(np.percentile(away, 95))
        widening = max(1.0, 0.9 * seen / float(np.hypot(extents[0], extents[2])))
        return extents * np.array([widening, 1.0, widening])

    def _refine(
        self, evidence: _Evidence, start: InitialPose, count: int, move: bool = True
    ) -> InitialPose:
        """Robust least squares over yaw, tilt, position, log height and log width."""
        problem = _Residuals(self, evidence, start, count, move)
        reach = 0.6 * float(np.linalg.norm(start.extents))
        bounds = np.array([4.0] * 3 + [reach] * 3 + [0.7, 0.7])
        solution = least_squares(
            problem,
            np.zeros(8),
            bounds=(-bounds, bounds),
            loss="huber",
            f_scale=2.0,
            max_nfev=12,
        )
        T_cam_obj, extents = problem.pose_at(solution.x)
        return InitialPose(T_cam_obj, extents, float(2.0 * solution.cost / problem.weight))

    def _implausible(self, extents: np.ndarray) -> float:
        """0 for an everyday size, growing with the logarithm of the excess."""
        low, high = DIAGONAL_RANGE_M.get(self._category, (0.03, 1.0))
        size = float(np.linalg.norm(extents))
        return 10.0 * max(0.0, float(np.log(low / size)), float(np.log(size / high)))


class _Residuals:
    """Distances over their noise for parameters [rotation vector, position, log height, width]."""

    def __init__(
        self, fit: _PriorFit, evidence: _Evidence, start: InitialPose, count: int, move: bool
    ) -> None:
        rng = np.random.default_rng(fit._config.seed)
        self._start, self._evidence, self._config = start, evidence, fit._config
        self._sides, self._free_size = fit._sides, fit._extents is None
        self._move = move
        self._symmetric = fit._category in SYMMETRIC_CATEGORIES
        laptop = fit._category == "laptop"
        doubt = fit._config.laptop_width_doubt if laptop else fit._config.width_doubt
        # Relative to the prior, not to the start.
        ratios = start.extents / fit._sides
        self._start_width = float(np.log(ratios[0] / ratios[1]))
        self._width_doubt = doubt
        self._unit_box = fit._shape / fit._sides
        self._tree_points = self._unit_box
        points = evidence.points_cam
        self._points = points[rng.permutation(len(points))[:count]]
        keep = rng.permutation(len(self._unit_box))[: 3 * count]
        self._outline = self._unit_box[keep]
        self._skin = self._unit_box[rng.permutation(len(self._unit_box))[:700]]
        contour = evidence.contour
        self._contour = contour[:: max(1, int(np.ceil(len(contour) / count)))]
        self._share = np.sqrt(len(self._points) / max(1, len(self._contour)))
        self.weight = float(len(self._points))
        self._tree = KDTree(self._unit_box * start.extents)

    def pose_at(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        extents = self._start.extents
        if self._free_size:
            extents = extents * np.exp(np.array([x[6] + x[7], x[6], x[6] + x[7]]))
        if not self._move:
            return self._start.T_cam_obj, extents
        R_step, _ = cv2.Rodrigues(x[:3])
        start = self._start.T_cam_obj
        return make_transform(R_step @ start[:3, :3], start[:3, 3] + x[3:6]), extents

    def __call__(self, x: np.ndarray) -> Float[np.ndarray, "R"]:
        T_cam_obj, extents = self.pose_at(x)
        return np.concatenate(
            [
                self._surface(T_cam_obj, extents),
                self._silhouette(T_cam_obj, extents),
                self._coverage(T_cam_obj, extents),
                self._prior(x),
            ]
        )

    def _surface(self, T_cam_obj: np.ndarray, extents: np.ndarray) -> np.ndarray:
        """From each observed point to the prior's surface."""
        points = transform_points(invert_transform(T_cam_obj), self._points)
        ratio = self._start.extents / extents
        _, index = self._tree.query(points * ratio)
        gaps = points - self._tree_points[index] * extents
        return np.linalg.norm(gaps, axis=-1) / self._noise(extents)

    def _silhouette(self, T_cam_obj: np.ndarray, extents: np.ndarray) -> np.ndarray:
        """From each prior point outside the mask back to it, in metres at the object's distance."""
        frame = self._evidence.frame
        x, y, z = self._projected(T_cam_obj, self._outline * extents)
        inside_x = np.clip(x, 0, frame.width - 1.001)
        inside_y = np.clip(y, 0, frame.height - 1.001)
        outside = _bilinear(self._evidence.outside_px, inside_x, inside_y)
        return outside * z / frame.K[0, 0] / self._noise(extents) / np.sqrt(3.0)

    def _coverage(self, T_cam_obj: np.ndarray, extents: np.ndarray) -> np.ndarray:
        """From each pixel of the mask's edge to the nearest prior point in the image, in metres."""
        x, y, _ = self._projected(T_cam_obj, self._skin * extents)
        away, _ = KDTree(np.column_stack([x, y])).query(self._contour)
        gap = away * T_cam_obj[2, 3] / self._evidence.frame.K[0, 0]
        gap = np.maximum(gap - 0.015 * float(np.linalg.norm(extents)), 0.0)
        return self._share * gap / self._noise(extents)

    def _projected(
        self, T_cam_obj: np.ndarray, points: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        K = self._evidence.frame.K
        points_cam = transform_points(T_cam_obj, points)
        z = np.maximum(points_cam[:, 2], 0.05)
        x = K[0, 0] * points_cam[:, 0] / z + K[0, 2]
        return x, K[1, 1] * points_cam[:, 1] / z + K[1, 2], z

    def _noise(self, extents: np.ndarray) -> float:
        """The prior is a cloud and a mean: its own spacing and error are part of the noise [m]."""
        return self._evidence.noise + 0.02 * float(np.linalg.norm(extents))

    def _prior(self, x: np.ndarray) -> np.ndarray:
        """Tilt stays near the plane's normal, the bottom on the plane, the shape near the mean."""
        strength = np.sqrt(self.weight)
        R_start = self._start.T_cam_obj[:3, :3]
        turn = R_start.T @ x[:3]
        known_up = self._evidence.plane is not None
        tilt_doubt = np.deg2rad(3.0 if known_up else 15.0)
        yaw_doubt = np.deg2rad(2.0 if self._symmetric else 180.0)
        doubts = np.array([tilt_doubt, yaw_doubt, tilt_doubt])
        terms = [
            strength * turn / doubts,
            [strength * (x[7] + self._start_width) / self._width_doubt],
        ]
        if known_up and self._evidence.plane is not None:
            T_cam_obj, extents = self.pose_at(x)
            bottom = T_cam_obj[:3, 3] - 0.5 * extents[1] * T_cam_obj[:3, 1]
            terms.append([strength * self._evidence.plane.height(bottom) / 0.01])
        if not self._move:
            terms.append(strength * x[:6])
        return np.concatenate([np.asarray(term, dtype=np.float64).ravel() for term in terms])


def _main_body(points: Float[np.ndarray, "P 3"]) -> Float[np.ndarray, "Q 3"]:
    """Without the few points far in front of or behind the rest (mixed pixels)."""
    if len(points) < _LEAST_POINTS:
        return points
    median = np.median(points, axis=0)
    away = np.linalg.norm(points - median, axis=-1)
    return points[away < 3.0 * np.percentile(away, 60) + 0.01]


def _contour(mask: Bool[np.ndarray, "H W"]) -> Float[np.ndarray, "C 2"]:
    """Edge pixels (x, y) of a mask that are not at the image's border."""
    height, width = mask.shape
    edge = mask & ~(cv2.erode(mask.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0)
    y, x = np.nonzero(edge)
    inner = (x > 2) & (x < width - 3) & (y > 2) & (y < height - 3)
    return np.stack([x[inner], y[inner]], axis=-1).astype(np.float64)


def _across(v: np.ndarray, up: np.ndarray) -> Float[np.ndarray, "3"]:
    return v - up * float(v @ up)


def _bilinear(image: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    x0, y0 = np.floor(x).astype(int), np.floor(y).astype(int)
    u, v = x - x0, y - y0
    top = image[y0, x0] * (1 - u) + image[y0, x0 + 1] * u
    bottom = image[y0 + 1, x0] * (1 - u) + image[y0 + 1, x0 + 1] * u
    return top * (1 - v) + bottom * v
