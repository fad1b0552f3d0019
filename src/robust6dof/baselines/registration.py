"""Rigid registration of one frame's points to a surface: robust, with a prior.

The nearest neighbours come from small_gicp's tree. Its own solvers are not used for the fit: its
GICP keeps a thousandth of the weight along the surface, which slows a cup's turn about its axis to
a crawl, and its Python interface has neither robust kernel nor prior.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import small_gicp
from jaxtyping import Bool, Float

from robust6dof.geometry.transforms import make_transform, transform_points


@dataclass(frozen=True, eq=False)
class Registration:
    """What a fit gives."""

    T_target_source: Float[np.ndarray, "4 4"]
    inliers: Bool[np.ndarray, "P"]
    """Source points with a partner within the last cutoff."""
    rms: float
    """Root mean square of the inliers' distances along the normals [m]."""


@dataclass(frozen=True, eq=False)
class Prior:
    """Independent standard deviations of the pose correction about the identity."""

    rotation: float
    """[rad]"""
    translation: float
    """[m]"""

    def information(self) -> Float[np.ndarray, "6 6"]:
        return np.diag([self.rotation**-2] * 3 + [self.translation**-2] * 3)


CORRELATION = 10.0
"""Neighbouring depth pixels err together: so many points count as one independent."""

_NORMAL_AGREEMENT = 0.5
"""Cosine below which the normals of a pair disagree: the other side of a thin wall."""


def register(
    source: Float[np.ndarray, "P 3"],
    source_normals: Float[np.ndarray, "P 3"],
    target: Float[np.ndarray, "M 3"],
    target_normals: Float[np.ndarray, "M 3"],
    tree: small_gicp.KdTree,
    *,
    cutoffs: Sequence[float],
    noise: float,
    prior: Prior,
    iterations: int = 8,
) -> Registration | None:
    """Gauss-Newton on the symmetric point-to-plane distance (Rusinkiewicz 2019) with Tukey weights.

    Source and target are in one frame up to a small correction, which `prior` bounds where the
    geometry does not. None when fewer than ten points find a partner.

    Args:
        tree: of `target`.
        cutoffs: largest correspondence distance of each stage [m], from coarse to fine.
        noise: standard deviation of the source points along the line of sight [m].
        iterations: at most, in each stage.
    """
    T = np.eye(4)
    inliers, distances = np.zeros(len(source), dtype=bool), np.zeros(0)
    for cutoff in cutoffs:
        for _ in range(iterations):
            moved = transform_points(T, source)
            moved_normals = source_normals @ T[:3, :3].T
            partner, squared = _nearest(tree, moved)
            inliers = squared < cutoff**2
            inliers &= np.sum(moved_normals * target_normals[partner], axis=-1) > _NORMAL_AGREEMENT
            if inliers.sum() < 10:
                return None
            step, distances = _gauss_newton_step(
                moved[inliers],
                moved_normals[inliers],
                target[partner[inliers]],
                target_normals[partner[inliers]],
                T,
                cutoff,
                noise,
                prior,
            )
            T = step @ T
            if np.linalg.norm(step[:3, 3]) < 5e-5 and np.trace(step[:3, :3]) > 3 - 1e-7:
                break
    return Registration(T, inliers, float(np.sqrt(np.mean(distances**2))))


def _nearest(tree: small_gicp.KdTree, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    index, squared = tree.batch_nearest_neighbor_search(points)
    return np.asarray(index, dtype=np.int64), np.asarray(squared)


def _gauss_newton_step(
    source: np.ndarray,
    source_normals: np.ndarray,
    target: np.ndarray,
    target_normals: np.ndarray,
    T: np.ndarray,
    cutoff: float,
    noise: float,
    prior: Prior,
) -> tuple[Float[np.ndarray, "4 4"], Float[np.ndarray, "Q"]]:
    """The left-multiplied step [rotation vector, translation], and the distances before it."""
    normals = source_normals + target_normals
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    distances = np.sum(normals * (source - target), axis=-1)
    # Both ends turn by half in the symmetric form; to first order the arm is their sum's half.
    arms = 0.5 * (source + target)
    J = np.concatenate([np.cross(arms, normals), normals], axis=-1)
    spread = max(1.48 * float(np.median(np.abs(distances))), 0.5 * noise)
    weights = _tukey(distances / min(4.0 * spread, cutoff))
    weights /= spread**2 * CORRELATION
    from_prior = np.concatenate([cv2.Rodrigues(T[:3, :3])[0].ravel(), T[:3, 3]])
    information = prior.information()
    H = (J * weights[:, None]).T @ J + information
    g = J.T @ (weights * distances) + information @ from_prior
    step: np.ndarray = -np.linalg.solve(H, g)
    return make_transform(cv2.Rodrigues(step[:3])[0], step[3:]), distances


def _tukey(scaled: np.ndarray) -> np.ndarray:
    """Tukey's biweight: 1 at zero, 0 beyond 1."""
    return np.square(np.clip(1.0 - np.square(scaled), 0.0, None))
