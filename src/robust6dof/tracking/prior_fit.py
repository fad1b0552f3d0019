"""A category's prior fitted to one segment of a frame, from many starts."""

from __future__ import annotations

from dataclasses import dataclass, replace

import cv2
import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import least_squares

from robust6dof.errors import InputError
from robust6dof.frames import SYMMETRIC_CATEGORIES, RgbdFrame
from robust6dof.geometry.camera import backproject
from robust6dof.geometry.transforms import (
    invert_transform,
    make_transform,
    rotation_about_y,
    transform_points,
)
from robust6dof.tracking.image_plane import local_plane
from robust6dof.tracking.prior_residuals import Evidence, InitialPose, PriorResiduals, PriorShape
from robust6dof.tracking.region import depth_noise, valid_depth
from robust6dof.tracking.segmentation import Segment

LEAST_POINTS = 30
"""With fewer depth pixels on the object there is nothing to fit."""

DIAGONAL_RANGE_M: dict[str, tuple[float, float]] = {
    "bottle": (0.12, 0.40),
    "bowl": (0.10, 0.35),
    "camera": (0.08, 0.30),
    "can": (0.08, 0.25),
    "laptop": (0.30, 0.70),
    "mug": (0.09, 0.25),
}
"""Diagonal of the box of everyday objects; a fit outside is a poor one."""


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


class PriorFit:
    """Fits the prior to one segment after the other."""

    def __init__(
        self,
        frame: RgbdFrame,
        category: str,
        points: Float[np.ndarray, "N 3"],
        extents: Float[np.ndarray, "3"] | None,
        config: InitialisationConfig,
    ) -> None:
        self._frame, self._category, self._config = frame, category, config
        self._extents = extents
        self._shape = PriorShape(
            points,
            category in SYMMETRIC_CATEGORIES,
            extents is None,
            config.laptop_width_doubt if category == "laptop" else config.width_doubt,
        )

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

    def _evidence(self, segment: Segment) -> Evidence | None:
        frame = self._frame
        solid = cv2.erode(segment.mask.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
        usable = solid if (solid & valid_depth(frame)).sum() > 200 else segment.mask
        points, _ = backproject(frame.depth, frame.K, usable & valid_depth(frame))
        points = _main_body(points)
        if len(points) < LEAST_POINTS:
            return None
        distance = float(np.median(points[:, 2]))
        nearer = valid_depth(frame) & (frame.depth < distance - 0.02) & ~segment.mask
        free = (~segment.mask & ~nearer).astype(np.uint8)
        plane = segment.plane or local_plane(frame, segment.mask, self._config.seed)
        return Evidence(
            points,
            0.002 + float(depth_noise(distance)),
            cv2.distanceTransform(free, cv2.DIST_L2, 3).astype(np.float64),
            _contour(segment.mask),
            frame,
            plane,
        )

    def _ups(self, evidence: Evidence) -> list[Float[np.ndarray, "3"]]:
        """Up directions in the camera frame: the plane's normal, else some that are usual."""
        if evidence.plane is not None:
            return [evidence.plane.normal]
        tilts = np.deg2rad([10.0, 35.0, 60.0])
        return [np.array([0.0, -np.cos(tilt), -np.sin(tilt)]) for tilt in tilts]

    def _starts(self, evidence: Evidence, up: Float[np.ndarray, "3"]) -> list[InitialPose]:
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
        count = 1 if self._shape.symmetric else self._config.yaw_starts
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
        extents = self._shape.sides / self._shape.sides[1] * height
        if self._category != "laptop":
            return extents
        flat = points - np.outer(points @ up, up)
        away = np.linalg.norm(flat - np.median(flat, axis=0), axis=-1)
        seen = 2.0 * float(np.percentile(away, 95))
        widening = max(1.0, 0.9 * seen / float(np.hypot(extents[0], extents[2])))
        return extents * np.array([widening, 1.0, widening])

    def _refine(
        self, evidence: Evidence, start: InitialPose, count: int, move: bool = True
    ) -> InitialPose:
        """Robust least squares over yaw, tilt, position, log height and log width."""
        problem = PriorResiduals(self._shape, evidence, start, count, move)
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


def _main_body(points: Float[np.ndarray, "P 3"]) -> Float[np.ndarray, "Q 3"]:
    """Without the few points far in front of or behind the rest (mixed pixels)."""
    if len(points) < LEAST_POINTS:
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
