"""Absolute similarity of one view from its points' canonical coordinates (the anchor)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from robust6dof.errors import InputError
from robust6dof.geometry.alignment import fit_similarity
from robust6dof.solver.rigid_ransac import sample_triples, square_residuals, triangle_frames


@dataclass(frozen=True, eq=False)
class AbsoluteFit:
    """Where the object is and how large, from one view."""

    T_cam_obj: Float[np.ndarray, "4 4"]
    """Rigid transform from the object frame to the camera."""
    scale: float
    """Box diagonal [m]."""
    inliers: Bool[np.ndarray, "P"]
    """Points within the inlier distance."""
    residual: float
    """Weighted root mean square over the inliers, as a share of the scale."""

    @property
    def inlier_share(self) -> float:
        """Share of the points that are inliers."""
        return float(self.inliers.mean())


def fit_absolute(
    canonical: Float[np.ndarray, "P 3"],
    points_cam: Float[np.ndarray, "P 3"],
    weight: Float[np.ndarray, "P"],
    rng: np.random.Generator,
    inlier_share: float = 0.08,
    hypotheses: int = 64,
    refinements: int = 5,
    scale_range: tuple[float, float] = (0.02, 2.0),
) -> AbsoluteFit:
    """Robust Umeyama fit of canonical coordinates (diagonal 1) to camera-frame points [m].

    Args:
        canonical: canonical coordinate of each point.
        points_cam: the points.
        weight: trust in each, such as `ViewFeatures.point_weight`.
        rng: source of the hypotheses.
        inlier_share: an inlier's residual, as a share of the scale.
        hypotheses: triples tried.
        refinements: reweighted fits that follow.
        scale_range: scales believed [m].

    Raises:
        InputError: fewer than three points, or one that is not finite.
    """
    canonical, points = np.asarray(canonical, np.float64), np.asarray(points_cam, np.float64)
    if len(points) < 3 or not (np.isfinite(points).all() and np.isfinite(canonical).all()):
        raise InputError(f"an absolute fit needs at least 3 finite points, got {len(points)}")
    w = np.asarray(weight, np.float64)
    w = w / max(w.sum(), 1e-12)
    T, scale = _best_hypothesis(canonical, points, w, rng, inlier_share, hypotheses, scale_range)
    for _ in range(refinements):
        share = _shares(T, scale, canonical, points)
        near = w * np.square(np.clip(1.0 - share / (2.0 * inlier_share) ** 2, 0.0, None))
        if np.count_nonzero(near) < 3:
            break
        T, fitted = fit_similarity(canonical, points, near)
        scale = float(np.clip(fitted, *scale_range))
    share = _shares(T, scale, canonical, points)
    inliers = share <= inlier_share**2
    weight_in = w[inliers].sum()
    residual = float(np.sqrt(w[inliers] @ share[inliers] / weight_in)) if weight_in > 0 else np.inf
    return AbsoluteFit(T, scale, inliers, residual)


def _best_hypothesis(
    canonical: np.ndarray,
    points: np.ndarray,
    w: np.ndarray,
    rng: np.random.Generator,
    inlier_share: float,
    hypotheses: int,
    scale_range: tuple[float, float],
) -> tuple[np.ndarray, float]:
    index = sample_triples(w, hypotheses, rng)
    src, dst = canonical[index], points[index]
    spread_src, spread_dst = (
        np.linalg.norm(x - x.mean(1, keepdims=True), axis=(1, 2)) for x in (src, dst)
    )
    scale = np.clip(spread_dst / np.maximum(spread_src, 1e-9), *scale_range)
    R = triangle_frames(dst) @ triangle_frames(src).swapaxes(-1, -2)
    t = dst.mean(1) - scale[:, None] * np.einsum("hij,hj->hi", R, src.mean(1))
    whole, scale_whole = fit_similarity(canonical, points, w)
    R, t = np.concatenate([R, whole[None, :3, :3]]), np.concatenate([t, whole[None, :3, 3]])
    scale = np.append(scale, np.clip(scale_whole, *scale_range))
    # The same rigid residuals after dividing by the scale: shares of the diagonal.
    square = square_residuals(scale[:, None, None] * R, t, canonical, points) / scale[:, None] ** 2
    best = int(np.argmin(np.minimum(square, inlier_share**2) @ w))
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = R[best], t[best]
    return T, float(scale[best])


def _shares(T: np.ndarray, scale: float, canonical: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Squared residuals as shares of the scale."""
    return (
        square_residuals(scale * T[None, :3, :3], T[None, :3, 3], canonical, points)[0] / scale**2
    )
