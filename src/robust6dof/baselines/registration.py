"""Rigid registration of one frame's points to the model: robust, with colour and a prior.

The nearest neighbours come from small_gicp's tree. Its solvers are not used for the fit: its GICP
keeps a thousandth of the weight along the surface, which slows a cup's turn about its axis to a
crawl, and its Python interface has no robust kernel, no colour and no prior.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import small_gicp
from jaxtyping import Bool, Float

from robust6dof.baselines.cloud import Cloud
from robust6dof.baselines.registration_target import RegistrationTarget
from robust6dof.geometry.transforms import make_transform, transform_points

_CORRELATION = 10.0
"""Neighbouring depth pixels err together: so many points count as one independent."""

_NORMAL_AGREEMENT = 0.5
"""Cosine below which the normals of a pair disagree: the other side of a thin wall."""

_LEAST_INTENSITY_ERROR = 6.0
"""Brightness is never trusted to better than this [levels]."""

_LEAST_PAIRS = 10


@dataclass(frozen=True)
class Prior:
    """Standard deviations of the pose correction about the identity."""

    rotation: float
    """[rad]"""
    translation: float
    """[m]"""

    def information(self) -> Float[np.ndarray, "6 6"]:
        return np.diag([self.rotation**-2] * 3 + [self.translation**-2] * 3)


@dataclass(frozen=True)
class Stage:
    """One pass of the registration."""

    cutoff: float
    """Largest distance between partners [m]."""
    iterations: int
    """At most."""
    every: int = 1
    """Use only each n-th source point."""
    color: bool = True
    """Compare brightness too; its basin is as narrow as the print's detail."""
    small_m: float = 1e-4
    """The stage ends with a step below this …"""
    small_rad: float = 1e-3
    """… and this."""


@dataclass(frozen=True, eq=False)
class Registration:
    """What a fit gives."""

    T_target_source: Float[np.ndarray, "4 4"]
    inliers: Bool[np.ndarray, "P"]
    """Points of the last stage that have a partner."""


@dataclass(frozen=True, eq=False)
class _Pairs:
    """Source points, moved by the current estimate, and their partners."""

    source: Cloud
    target: Cloud
    gradients: Float[np.ndarray, "Q 3"]


def register(
    source: Cloud,
    target: RegistrationTarget,
    *,
    stages: Sequence[Stage],
    noise: float,
    prior: Prior,
) -> Registration | None:
    """Gauss-Newton over pairs found anew in each iteration.

    Minimises the symmetric point-to-plane distance (Rusinkiewicz 2019) and the brightness
    difference along the surface (Park, Zhou, Koltun 2017), both with Tukey weights.
    Source and target are in one frame up to a small correction, which `prior` bounds where the
    images do not. None when fewer than ten points find a partner.

    Args:
        stages: from coarse to fine.
        noise: standard deviation of the source points along the line of sight [m].
    """
    T = np.eye(4)
    inliers = np.zeros(len(source), dtype=bool)
    for stage in stages:
        part = source[:: stage.every]
        for _ in range(stage.iterations):
            pairs, inliers = _pair(part, target, T, stage.cutoff)
            if inliers.sum() < _LEAST_PAIRS:
                return None
            H, g = _geometric_terms(pairs, stage.cutoff, noise)
            if stage.color:
                H_color, g_color = _color_terms(pairs)
                H, g = H + H_color, g + g_color
            step = _solve(H, g, T, prior)
            T = step @ T
            if np.linalg.norm(step[:3, 3]) < stage.small_m and _angle(step) < stage.small_rad:
                break
    return Registration(T, inliers)


def _pair(
    source: Cloud, target: RegistrationTarget, T: np.ndarray, cutoff: float
) -> tuple[_Pairs, Bool[np.ndarray, "P"]]:
    points = transform_points(T, source.points)
    normals = source.normals @ T[:3, :3].T
    index, squared = _nearest(target.tree, points)
    inliers = squared < cutoff**2
    inliers &= np.einsum("pc,pc->p", normals, target.cloud.normals[index]) > _NORMAL_AGREEMENT
    chosen = index[inliers]
    moved = Cloud(points[inliers], normals[inliers], source.intensity[inliers])
    return _Pairs(moved, target.cloud[chosen], target.gradients[chosen]), inliers


def _nearest(tree: small_gicp.KdTree, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    index, squared = tree.batch_nearest_neighbor_search(points)
    return np.asarray(index, dtype=np.int64), np.asarray(squared)


def _geometric_terms(
    pairs: _Pairs, cutoff: float, noise: float
) -> tuple[Float[np.ndarray, "6 6"], Float[np.ndarray, "6"]]:
    """Normal equations of the point-to-plane distances for a left-multiplied step [ω, v]."""
    normals = pairs.source.normals + pairs.target.normals
    normals /= np.sqrt(np.einsum("pc,pc->p", normals, normals))[:, None]
    distances = np.einsum("pc,pc->p", normals, pairs.source.points - pairs.target.points)
    J = np.concatenate([_cross(pairs.source.points, normals), normals], axis=-1)
    spread = max(1.48 * _median(np.abs(distances)), 0.5 * noise)
    weights = _tukey(distances / min(4.0 * spread, cutoff)) / (spread**2 * _CORRELATION)
    return _normal_equations(J, distances, weights)


def _color_terms(pairs: _Pairs) -> tuple[Float[np.ndarray, "6 6"], Float[np.ndarray, "6"]]:
    """Normal equations of the brightness differences; a common offset (exposure) is taken out."""
    known = ~np.isnan(pairs.source.intensity) & ~np.isnan(pairs.target.intensity)
    if known.sum() < _LEAST_PAIRS:
        return np.zeros((6, 6)), np.zeros(6)
    points, gradients = pairs.source.points[known], pairs.gradients[known]
    predicted = pairs.target.intensity[known] + np.einsum(
        "pc,pc->p", gradients, points - pairs.target.points[known]
    )
    differences = predicted - pairs.source.intensity[known]
    differences -= _median(differences)
    J = np.concatenate([_cross(points, gradients), gradients], axis=-1)
    spread = max(1.48 * _median(np.abs(differences)), _LEAST_INTENSITY_ERROR)
    weights = _tukey(differences / (4.0 * spread)) / (spread**2 * _CORRELATION)
    return _normal_equations(J, differences, weights)


def _normal_equations(
    J: np.ndarray, residuals: np.ndarray, weights: np.ndarray
) -> tuple[Float[np.ndarray, "6 6"], Float[np.ndarray, "6"]]:
    weighted = J * weights[:, None]
    return weighted.T @ J, weighted.T @ residuals


def _solve(H: np.ndarray, g: np.ndarray, T: np.ndarray, prior: Prior) -> Float[np.ndarray, "4 4"]:
    from_prior = np.concatenate([cv2.Rodrigues(T[:3, :3])[0].ravel(), T[:3, 3]])
    information = prior.information()
    step: np.ndarray = -np.linalg.solve(H + information, g + information @ from_prior)
    return make_transform(cv2.Rodrigues(step[:3])[0], step[3:])


def _angle(T: np.ndarray) -> float:
    """Rotation angle [rad], for small turns."""
    return 0.5 * float(np.linalg.norm(T[:3, :3] - T[:3, :3].T)) / np.sqrt(2.0)


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Row-wise cross product; numpy's own is several times slower on short arrays."""
    x, y, z = a.T
    u, v, w = b.T
    return np.stack([y * w - z * v, z * u - x * w, x * v - y * u], axis=-1)


def _median(values: np.ndarray) -> float:
    """Upper median, without numpy's overhead."""
    middle = len(values) // 2
    return float(np.partition(values, middle)[middle])


def _tukey(scaled: np.ndarray) -> np.ndarray:
    """Tukey's biweight: 1 at zero, 0 beyond 1."""
    return np.square(np.clip(1.0 - np.square(scaled), 0.0, None))
