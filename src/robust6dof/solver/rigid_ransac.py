"""RANSAC and a weighted rigid fit on 3D-3D pairs, all hypotheses at once."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from robust6dof.errors import InputError
from robust6dof.geometry.alignment import fit_rigid

_TINY = 1e-12


@dataclass(frozen=True, eq=False)
class RigidFit:
    """A transform and how well the pairs agree with it."""

    T_dst_src: Float[np.ndarray, "4 4"]
    """Maps source points to their partners."""
    inliers: Bool[np.ndarray, "P"]
    """Pairs within the inlier distance."""
    residual: float
    """Weighted root mean square over the inliers [m]; infinite if there is none."""

    @property
    def inlier_share(self) -> float:
        """Share of the pairs that are inliers."""
        return float(self.inliers.mean()) if len(self.inliers) else 0.0


def ransac_rigid(
    src: Float[np.ndarray, "P 3"],
    dst: Float[np.ndarray, "P 3"],
    weight: Float[np.ndarray, "P"] | None,
    inlier_distance: float,
    rng: np.random.Generator,
    hypotheses: int = 96,
    refinements: int = 4,
) -> RigidFit:
    """T_dst_src that most weight agrees with.

    Each hypothesis aligns the triangles of three pairs, drawn by weight; the best one, by truncated
    squared residuals, is refined by reweighted Kabsch fits on its inliers.

    Raises:
        InputError: fewer than three pairs, or a pair that is not finite.
    """
    src, dst = _check_pairs(src), _check_pairs(dst)
    w = np.ones(len(src)) if weight is None else np.asarray(weight, np.float64)
    w = w / max(w.sum(), _TINY)
    T = _best_hypothesis(src, dst, w, inlier_distance, rng, hypotheses)
    for _ in range(refinements):
        square = _square_residuals(T, src, dst)
        near = w * np.square(np.clip(1.0 - square / (2.0 * inlier_distance) ** 2, 0.0, None))
        if np.count_nonzero(near) < 3:
            break
        T = fit_rigid(src, dst, near)
    square = _square_residuals(T, src, dst)
    inliers = square <= inlier_distance**2
    weight_in = w[inliers].sum()
    residual = float(np.sqrt(w[inliers] @ square[inliers] / weight_in)) if weight_in > 0 else np.inf
    return RigidFit(T, inliers, residual)


def _check_pairs(points: np.ndarray) -> Float[np.ndarray, "P 3"]:
    points = np.asarray(points, np.float64)
    if points.ndim != 2 or points.shape[1] != 3 or len(points) < 3:
        raise InputError(f"a rigid fit needs at least 3 pairs of 3D points, got {points.shape}")
    if not np.isfinite(points).all():
        raise InputError("a rigid fit needs finite points")
    return points


def _best_hypothesis(
    src: np.ndarray,
    dst: np.ndarray,
    w: np.ndarray,
    inlier_distance: float,
    rng: np.random.Generator,
    hypotheses: int,
) -> Float[np.ndarray, "4 4"]:
    index = sample_triples(w, hypotheses, rng)
    R = triangle_frames(dst[index]) @ triangle_frames(src[index]).swapaxes(-1, -2)
    t = dst[index].mean(1) - np.einsum("hij,hj->hi", R, src[index].mean(1))
    whole = fit_rigid(src, dst, w)  # the fit to all pairs is one more hypothesis
    R, t = np.concatenate([R, whole[None, :3, :3]]), np.concatenate([t, whole[None, :3, 3]])
    square = square_residuals(R, t, src, dst)
    cost = np.minimum(square, inlier_distance**2) @ w
    T = np.eye(4)
    best = int(np.argmin(cost))
    T[:3, :3], T[:3, 3] = R[best], t[best]
    return T


def sample_triples(w: Float[np.ndarray, "P"], count: int, rng: np.random.Generator) -> np.ndarray:
    """Indices [count, 3] drawn by weight (a triple may repeat a pair, and then loses)."""
    edges = np.cumsum(w)
    return np.searchsorted(edges / edges[-1], rng.random((count, 3))).clip(max=len(w) - 1)


def triangle_frames(triangle: Float[np.ndarray, "H 3 3"]) -> Float[np.ndarray, "H 3 3"]:
    """A right-handed frame fixed to each triangle (columns); the identity's where it is flat."""
    x = _unit(triangle[:, 1] - triangle[:, 0], (1.0, 0.0, 0.0))
    across = triangle[:, 2] - triangle[:, 0]
    y = _unit(across - (x * across).sum(-1, keepdims=True) * x, None)
    flat = ~np.isfinite(y).all(-1)
    frames = np.stack([x, y, np.cross(x, y)], -1)
    frames[flat] = np.eye(3)
    return frames


def _unit(v: np.ndarray, fallback: tuple[float, float, float] | None) -> np.ndarray:
    length = np.linalg.norm(v, axis=-1, keepdims=True)
    other = np.full(3, np.nan) if fallback is None else np.array(fallback)
    return np.where(length > 1e-9, v / np.maximum(length, 1e-9), other)


def square_residuals(
    R: Float[np.ndarray, "H 3 3"],
    t: Float[np.ndarray, "H 3"],
    src: Float[np.ndarray, "P 3"],
    dst: Float[np.ndarray, "P 3"],
) -> Float[np.ndarray, "H P"]:
    """‖dst − (R src + t)‖² of each hypothesis and pair."""
    moved = src @ R.swapaxes(-1, -2) + t[:, None]
    moved -= dst
    return np.einsum("hpi,hpi->hp", moved, moved)


def _square_residuals(T: np.ndarray, src: np.ndarray, dst: np.ndarray) -> np.ndarray:
    return square_residuals(T[None, :3, :3], T[None, :3, 3], src, dst)[0]
