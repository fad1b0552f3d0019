"""Rigid registration of one frame's points to the model: robust, with colour and a prior.

The nearest neighbours come from small_gicp's tree. Its solvers are not used for the fit: its GICP
keeps a thousandth of the weight along the surface, which slows a cup's turn about its axis to a
crawl, and its Python interface has no robust kernel, no colour and no prior.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
import small_gicp
from jaxtyping import Float

from robust6dof.geometry.transforms import invert_transform, make_transform, transform_points
from robust6dof.tracking.surface.cloud import Cloud
from robust6dof.tracking.surface.registration_target import RegistrationTarget

_CORRELATION = 10.0
"""Neighbouring depth pixels err together: so many points count as one independent."""

_NORMAL_AGREEMENT = 0.5
"""Cosine below which the normals of a pair disagree: the other side of a thin wall."""

_LEAST_INTENSITY_ERROR = 6.0
"""Brightness is never trusted to better than this [levels]."""

_LEAST_PAIRS = 10


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
    small_m: float = 2e-4
    """The stage ends with a step below this …"""
    small_rad: float = 1e-3
    """… and this."""


@dataclass(frozen=True, eq=False)
class Evidence:
    """A cloud and what it is fitted to; several of them share one motion."""

    source: Cloud
    target: RegistrationTarget
    noise: float
    """Standard deviation of the source points along the line of sight [m]."""
    spacing: float = 0.0
    """Distance between neighbouring points [m]: partners are looked for at least this far."""


@dataclass(frozen=True, eq=False)
class Registration:
    """What a fit gives."""

    T_target_source: Float[np.ndarray, "4 4"]
    shares: tuple[float, ...]
    """Of each evidence: the share of its points that have a partner in the last stage."""
    information: Float[np.ndarray, "6 6"]
    """Inverse covariance of a left-multiplied step [rotation, translation], the prior included."""
    prior: Float[np.ndarray, "6 6"]

    @property
    def seen_rotation(self) -> Float[np.ndarray, "3 3"]:
        """Share of the rotation, target axes, that the images decided, not the prior: the identity,
        but for turns that change nothing in them."""
        return np.linalg.solve(self.information, self.information - self.prior)[:3, :3]


def independent(rotation: float, translation: float) -> Float[np.ndarray, "6 6"]:
    """Information of a correction with these standard deviations [rad], [m] about each axis."""
    return np.diag([rotation**-2] * 3 + [translation**-2] * 3)


@dataclass(frozen=True, eq=False)
class _Pairs:
    """Source points, moved by the current estimate, and their partners."""

    source: Cloud
    target: Cloud
    gradients: Float[np.ndarray, "Q 3"]


def register(
    evidence: Sequence[Evidence],
    stages: Sequence[Stage],
    prior: Float[np.ndarray, "6 6"],
    T_start: Float[np.ndarray, "4 4"] | None = None,
) -> Registration | None:
    """Gauss-Newton over pairs found anew in each iteration.

    Minimises the symmetric point-to-plane distance (Rusinkiewicz 2019) and the brightness
    difference along the surface (Park, Zhou, Koltun 2017), both with Tukey weights. Sources and
    targets are in one frame up to a small correction, which the prior bounds where the images do
    not. None when fewer than ten points find a partner.

    Args:
        stages: from coarse to fine.
        prior: information (inverse covariance) of the correction [rotation, translation] about
            the start; see `independent`.
        T_start: `T_target_source` to begin with; by default the identity.
    """
    start = np.eye(4) if T_start is None else T_start
    T, H = start, np.zeros((6, 6))
    counts, parts = np.zeros(len(evidence)), list(evidence)
    for stage in stages:
        parts = [replace(one, source=one.source[:: stage.every]) for one in evidence]
        for _ in range(stage.iterations):
            H, g, counts = _all_terms(parts, T, stage)
            if counts.sum() < _LEAST_PAIRS:
                return None
            step = _solve(H, g, T @ invert_transform(start), prior)
            T = step @ T
            if np.linalg.norm(step[:3, 3]) < stage.small_m and _angle(step) < stage.small_rad:
                break
    shares = tuple(float(n) / max(1, len(one.source)) for n, one in zip(counts, parts, strict=True))
    return Registration(T, shares, H + prior, prior)


def _all_terms(
    evidence: Sequence[Evidence], T: np.ndarray, stage: Stage
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Sum of the normal equations, and the number of pairs of each evidence."""
    H, g, counts = np.zeros((6, 6)), np.zeros(6), np.zeros(len(evidence))
    for number, one in enumerate(evidence):
        cutoff = max(stage.cutoff, 1.5 * one.spacing)
        pairs = _pair(one.source, one.target, T, cutoff)
        if len(pairs.source) < _LEAST_PAIRS:
            continue
        counts[number] = len(pairs.source)
        terms = [_geometric_terms(pairs, cutoff, one.noise)]
        if stage.color:
            terms.append(_color_terms(pairs))
        H = H + sum(term[0] for term in terms)
        g = g + sum(term[1] for term in terms)
    return H, g, counts


def _pair(source: Cloud, target: RegistrationTarget, T: np.ndarray, cutoff: float) -> _Pairs:
    if not len(source) or not len(target.cloud):  # small_gicp crashes on an empty tree
        return _Pairs(source[:0], target.cloud[:0], target.gradients[:0])
    points = transform_points(T, source.points)
    normals = source.normals @ T[:3, :3].T
    index, squared = _nearest(target.tree, points)
    inliers = squared < cutoff**2
    inliers &= np.einsum("pc,pc->p", normals, target.cloud.normals[index]) > _NORMAL_AGREEMENT
    chosen = index[inliers]
    moved = Cloud(points[inliers], normals[inliers], source.color[inliers])
    return _Pairs(moved, target.cloud[chosen], target.gradients[chosen])


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
    # Not narrower than a share of the cutoff: walls that slide along themselves fit well and must
    # not make an outlier of the rim, which alone tells of a lift.
    reach = float(np.clip(4.0 * spread, 0.4 * cutoff, cutoff))
    weights = _tukey(distances / reach) / (spread**2 * _CORRELATION)
    return _normal_equations(J, distances, weights)


def _color_terms(pairs: _Pairs) -> tuple[Float[np.ndarray, "6 6"], Float[np.ndarray, "6"]]:
    """Normal equations of the brightness differences; a common offset (exposure) is taken out."""
    source, target = pairs.source.intensity, pairs.target.intensity
    known = ~np.isnan(source) & ~np.isnan(target)
    if known.sum() < _LEAST_PAIRS:
        return np.zeros((6, 6)), np.zeros(6)
    points, gradients = pairs.source.points[known], pairs.gradients[known]
    predicted = target[known] + np.einsum(
        "pc,pc->p", gradients, points - pairs.target.points[known]
    )
    differences = predicted - source[known]
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


def _solve(
    H: np.ndarray, g: np.ndarray, T: np.ndarray, prior: np.ndarray
) -> Float[np.ndarray, "4 4"]:
    from_prior = np.concatenate([cv2.Rodrigues(T[:3, :3])[0].ravel(), T[:3, 3]])
    step: np.ndarray = -np.linalg.solve(H + prior, g + prior @ from_prior)
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
