"""Damped, weighted least squares, with the null space put to use."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float


def damped_inverse(
    A: Float[np.ndarray, "m n"], damping: float, threshold: float
) -> Float[np.ndarray, "n m"]:
    """Pseudo-inverse of A, exact away from singularities.

    Singular values σ below `threshold` are inverted as σ / (σ² + μ²) with
    μ² = (1 − (σ/threshold)²) · damping², so that the solution stays bounded and continuous
    (numerical filtering after Nakamura & Hanafusa 1986 and Maciejewski & Klein 1988).
    """
    U, s, Vt = np.linalg.svd(A, full_matrices=False)
    mu_sq = np.where(s < threshold, (1.0 - (s / threshold) ** 2) * damping**2, 0.0)
    return Vt.T @ np.diag(s / (s**2 + mu_sq)) @ U.T


def weighted_solution(
    A: Float[np.ndarray, "m n"],
    b: Float[np.ndarray, "m"],
    weights: Float[np.ndarray, "n"],
    preference: Float[np.ndarray, "n"],
    damping: float,
    threshold: float,
) -> Float[np.ndarray, "n"]:
    """x with A x = b that is nearest to `preference` in the norm Σ wᵢ (xᵢ − pᵢ)².

    Damped near singularities, where A x = b holds only nearly.
    """
    root = np.sqrt(weights)
    A_scaled = A / root
    inverse = damped_inverse(A_scaled, damping, threshold)
    return preference + (inverse @ (b - A @ preference)) / root


def bounded_solution(
    A: Float[np.ndarray, "m n"],
    b: Float[np.ndarray, "m"],
    weights: Float[np.ndarray, "n"],
    preference: Float[np.ndarray, "n"],
    lower: Float[np.ndarray, "n"],
    upper: Float[np.ndarray, "n"],
    damping: float,
    threshold: float,
) -> Float[np.ndarray, "n"]:
    """`weighted_solution` within bounds: what breaks one is fixed there, the rest makes up."""
    fixed: Bool[np.ndarray, "n"] = np.zeros(len(weights), dtype=bool)
    x = np.zeros(len(weights))
    for _ in range(len(weights)):
        free = ~fixed
        x[free] = weighted_solution(
            A[:, free],
            b - A[:, fixed] @ x[fixed],
            weights[free],
            preference[free],
            damping,
            threshold,
        )
        broken = free & ((x < lower) | (x > upper))
        if not broken.any():
            break
        x[broken] = np.clip(x[broken], lower[broken], upper[broken])
        fixed |= broken
    return np.clip(x, lower, upper)
