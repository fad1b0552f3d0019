"""Random fields that are smooth over a few pixels, as the errors of window matching are."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Float32


def smooth_noise(
    height: int, width: int, sigma_x: float, sigma_y: float, rng: np.random.Generator
) -> Float32[np.ndarray, "height width"]:
    """Gaussian field with mean 0, variance 1 and autocorrelation exp(−Δx²/4σ_x² − Δy²/4σ_y²).

    White noise smoothed by a Gaussian of standard deviations (σ_x, σ_y) px has this
    autocorrelation. It is drawn on a grid of at most 0.8 σ and interpolated, which is as good and
    costs less.
    """
    step_x, step_y = max(int(0.8 * sigma_x), 1), max(int(0.8 * sigma_y), 1)
    kernel_x, kernel_y = (
        _unit_energy_kernel(sigma_x / step_x),
        _unit_energy_kernel(sigma_y / step_y),
    )
    margin_x, margin_y = len(kernel_x) // 2 + 2, len(kernel_y) // 2 + 2
    coarse_height = -(-height // step_y) + 2 * margin_y
    coarse_width = -(-width // step_x) + 2 * margin_x
    white = rng.standard_normal((coarse_height, coarse_width), dtype=np.float32)
    field = cv2.sepFilter2D(white, cv2.CV_32F, kernel_x, kernel_y)
    if step_x > 1 or step_y > 1:
        fine_size = (coarse_width * step_x, coarse_height * step_y)
        field = cv2.resize(field, fine_size, interpolation=cv2.INTER_CUBIC)
    top, left = margin_y * step_y, margin_x * step_x
    return np.asarray(field)[top : top + height, left : left + width]


def _unit_energy_kernel(sigma: float) -> Float32[np.ndarray, "k"]:
    """Gaussian taps whose squares sum to one, so that white noise keeps its variance."""
    radius = int(np.ceil(3.5 * sigma))
    taps = np.exp(-0.5 * (np.arange(-radius, radius + 1) / max(sigma, 1e-6)) ** 2)
    return (taps / np.linalg.norm(taps)).astype(np.float32)
