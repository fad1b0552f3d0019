"""How far a category's prior at some pose and size is from what a frame shows of the object."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial import KDTree

from robust6dof.frames import RgbdFrame
from robust6dof.geometry.transforms import invert_transform, make_transform, transform_points
from robust6dof.tracking.support_plane import Plane


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


@dataclass(frozen=True, eq=False)
class PriorShape:
    """The category's prior and what may change about it."""

    points: Float[np.ndarray, "N 3"]
    """Canonical axes, centred on the box."""
    symmetric: bool
    """Whether a turn about y means nothing."""
    free_size: bool
    """Whether height and width are fitted."""
    width_doubt: float
    """Standard deviation of log(width / height) about the prior's."""

    @property
    def sides(self) -> Float[np.ndarray, "3"]:
        """Of the box."""
        return np.ptp(self.points, axis=0)


@dataclass(frozen=True, eq=False)
class Evidence:
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


class PriorResiduals:
    """Distances over their noise for parameters [rotation vector, position, log height, width]."""

    def __init__(
        self, shape: PriorShape, evidence: Evidence, start: InitialPose, count: int, move: bool
    ) -> None:
        rng = np.random.default_rng(0)
        self._shape, self._start, self._evidence = shape, start, evidence
        self._move = move
        # The width's doubt is about the prior, not about the start.
        ratios = start.extents / shape.sides
        self._start_width = float(np.log(ratios[0] / ratios[1]))
        self._unit_box = shape.points / shape.sides
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
        if self._shape.free_size:
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
        gaps = points - self._unit_box[index] * extents
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
        yaw_doubt = np.deg2rad(2.0 if self._shape.symmetric else 180.0)
        doubts = np.array([tilt_doubt, yaw_doubt, tilt_doubt])
        terms = [
            strength * turn / doubts,
            [strength * (x[7] + self._start_width) / self._shape.width_doubt],
        ]
        if known_up and self._evidence.plane is not None:
            T_cam_obj, extents = self.pose_at(x)
            bottom = T_cam_obj[:3, 3] - 0.5 * extents[1] * T_cam_obj[:3, 1]
            terms.append([strength * self._evidence.plane.height(bottom) / 0.01])
        if not self._move:
            terms.append(strength * x[:6])
        return np.concatenate([np.asarray(term, dtype=np.float64).ravel() for term in terms])


def _bilinear(image: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    x0, y0 = np.floor(x).astype(int), np.floor(y).astype(int)
    u, v = x - x0, y - y0
    top = image[y0, x0] * (1 - u) + image[y0, x0 + 1] * u
    bottom = image[y0 + 1, x0] * (1 - u) + image[y0 + 1, x0 + 1] * u
    return top * (1 - v) + bottom * v
