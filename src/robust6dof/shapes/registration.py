"""Non-rigid registration of one shape's points to another's, with surface normals.

Coherent point drift (Myronenko and Song, "Point set registration: coherent point drift", PAMI
2010, section 5), with two changes: normals enter the correspondence, so that the two sides of a
thin wall stay apart; and the reach σ follows a fixed schedule instead of being estimated.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial.distance import cdist


@dataclass(frozen=True)
class DriftConfig:
    """Lengths in units of the shapes' diagonal."""

    kernel_width: float = 0.3
    """β: how far points move together."""
    stiffness: float = 10.0
    """λ: weight of a smooth motion against a close fit."""
    first_sigma: float = 0.2
    """Reach of a correspondence at the start."""
    last_sigma: float = 0.025
    """Reach at the end."""
    normal_weight: float = 0.15
    """Distance that perpendicular normals count for, over √2."""
    outliers: float = 0.1
    """Share of points without a counterpart."""
    iterations: int = 16


@dataclass(frozen=True, eq=False)
class Drift:
    """A smooth motion: x ↦ x + Σ_m exp(−|x − c_m|² / 2β²) w_m."""

    centres: Float[np.ndarray, "M 3"]
    weights: Float[np.ndarray, "M 3"]
    kernel_width: float

    def apply(self, points: Float[np.ndarray, "N 3"]) -> Float[np.ndarray, "N 3"]:
        return points + _kernel(points, self.centres, self.kernel_width) @ self.weights

    def turn(
        self, points: Float[np.ndarray, "N 3"], normals: Float[np.ndarray, "N 3"]
    ) -> Float[np.ndarray, "N 3"]:
        """Unit normals of the moved surface, from two moved tangents (finite differences)."""
        least = np.eye(3)[np.abs(normals).argmin(axis=1)]
        first = np.cross(normals, least)
        first /= np.linalg.norm(first, axis=1, keepdims=True)
        second, step, moved = np.cross(normals, first), 1e-4, self.apply(points)
        a = self.apply(points + step * first) - moved
        b = self.apply(points + step * second) - moved
        turned = np.cross(a, b)
        return turned / np.linalg.norm(turned, axis=1, keepdims=True)


def register(
    source: Float[np.ndarray, "M 3"],
    source_normals: Float[np.ndarray, "M 3"],
    target: Float[np.ndarray, "N 3"],
    target_normals: Float[np.ndarray, "N 3"],
    config: DriftConfig = DriftConfig(),
) -> Drift:
    """The smooth motion that brings the source's surface onto the target's.

    Each target point is explained by source points (a Gaussian mixture); the reach σ shrinks
    geometrically, so that the fit goes from coarse to fine.
    """
    kernel = _kernel(source, source, config.kernel_width)
    weights = np.zeros_like(source)
    normal_cost = config.normal_weight**2 * cdist(source_normals, target_normals, "sqeuclidean")
    for sigma in np.geomspace(config.first_sigma, config.last_sigma, config.iterations):
        moved = source + kernel @ weights
        cost = cdist(moved, target, "sqeuclidean") + normal_cost
        share = _responsibility(cost, sigma, config.outliers)
        total = share.sum(axis=1)
        pull = share @ target - total[:, None] * source
        system = total[:, None] * kernel
        system[np.diag_indices_from(system)] += config.stiffness * sigma**2
        weights = np.linalg.solve(system, pull)
    return Drift(source, weights, config.kernel_width)


def _responsibility(
    cost: Float[np.ndarray, "M N"], sigma: float, outliers: float
) -> Float[np.ndarray, "M N"]:
    """Posterior of each source point for each target point (columns add up to at most 1)."""
    count, targets = cost.shape
    likelihood = np.exp(-cost / (2 * sigma**2))
    constant = (2 * np.pi * sigma**2) ** 1.5 * outliers / (1 - outliers) * count / targets
    return likelihood / (likelihood.sum(axis=0) + constant + 1e-300)


def _kernel(
    a: Float[np.ndarray, "N 3"], b: Float[np.ndarray, "M 3"], width: float
) -> Float[np.ndarray, "N M"]:
    return np.exp(-cdist(a, b, "sqeuclidean") / (2 * width**2))
