"""Exact depth to what a stereo matcher measures: effect by effect, in disparity.

Formulas and sources: docs/sensor-model.md.
"""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Float, Float32, UInt8
from scipy.special import ndtr, ndtri

from robust6dof.rendering import depth_kernels
from robust6dof.rendering.noise_fields import smooth_noise
from robust6dof.rendering.scene import Rendering
from robust6dof.rendering.sensor_config import StereoSensorConfig

SHINY_LUMINANCE = 250
# Φ⁻¹ of dropout probabilities 0, 1/1024, …, 1: a Gaussian field below it is a hole.
_HOLE_THRESHOLDS = ndtri(np.linspace(0.0, 1.0, 1025))


def observe_depth(
    rendering: Rendering,
    K: Float[np.ndarray, "3 3"],
    config: StereoSensorConfig,
    rng: np.random.Generator,
) -> Float32[np.ndarray, "H W"]:
    """Depth [m] as the stereo camera reports it; 0 where it finds no match."""
    height, width = rendering.depth.shape
    stereo_per_image = config.stereo_focal_px / K[0, 0]
    focal_baseline = config.stereo_focal_px * config.baseline_m
    disparity = depth_kernels.to_disparity(rendering.depth, focal_baseline)
    matched = disparity.copy()
    if config.occlusion:
        left_edge = _left_edge(config, stereo_per_image * K[0, 2])
        depth_kernels.drop_occluded(disparity, stereo_per_image, left_edge, matched)
    _fatten(disparity, config, rng, matched)
    noise = _field(config.disparity_noise_px, config.noise_correlation_px, disparity.shape, rng)
    depth = np.empty((height, width), np.float32)
    depth_kernels.measure(
        rendering.depth,
        disparity,
        matched,
        noise,
        focal_baseline,
        _search_limit(config),
        focal_baseline / config.max_range_m if config.max_range_m > 0 else 0.0,
        float(config.disparity_step_px),
        float(config.depth_unit_m),
        depth,
    )
    if _has_dropouts(config):
        correlation = (config.dropout_correlation_px, config.dropout_correlation_px)
        depth_kernels.drop_out(
            disparity,
            _dropout_by_appearance(rendering, config, stereo_per_image),
            _field(1.0, correlation, disparity.shape, rng),
            np.cos(np.radians(np.array(config.grazing_deg, np.float64))),
            float(config.edge_dropout),
            float(config.edge_disparity_px),
            np.asarray(K, np.float64),
            _HOLE_THRESHOLDS,
            depth,
        )
    return depth


def _left_edge(config: StereoSensorConfig, centre_px: float) -> float:
    """Where the right stereo image begins, in stereo pixels from the colour image's left edge."""
    return centre_px - config.stereo_width_px / 2 if config.stereo_width_px > 0 else -np.inf


def _search_limit(config: StereoSensorConfig) -> float:
    return float(config.max_disparity_px) if config.max_disparity_px > 0 else np.inf


def _has_dropouts(config: StereoSensorConfig) -> bool:
    by_appearance = config.fill_rate < 1.0 or config.shiny_dropout > 0
    return by_appearance or config.edge_dropout > 0 or config.grazing_deg[0] < 90.0


def _field(
    sigma: float,
    correlation_px: tuple[float, float],
    shape: tuple[int, int],
    rng: np.random.Generator,
) -> Float32[np.ndarray, "H W"]:
    if sigma <= 0:
        return np.zeros(shape, np.float32)
    return np.float32(sigma) * smooth_noise(*shape, *correlation_px, rng)


def _fatten(
    disparity: Float32[np.ndarray, "H W"],
    config: StereoSensorConfig,
    rng: np.random.Generator,
    matched: Float32[np.ndarray, "H W"],
) -> None:
    """Let near surfaces grow over their outlines in `matched`, by a smoothly varying width."""
    widest = round(config.edge_fattening_px + 2 * config.edge_jitter_px)
    if widest < 1:
        return
    grown = np.empty((widest, *disparity.shape), np.float32)
    square = np.ones((3, 3), np.uint8)
    for i in range(widest):
        cv2.dilate(disparity if i == 0 else grown[i - 1], square, dst=grown[i])
    growth = _field(config.edge_jitter_px, (3.0, 3.0), disparity.shape, rng)
    step_px = float(config.edge_disparity_px)
    depth_kernels.fatten(
        disparity, grown, growth, float(config.edge_fattening_px), step_px, matched
    )


def _dropout_by_appearance(
    rendering: Rendering, config: StereoSensorConfig, stereo_per_image: float
) -> Float32[np.ndarray, "H W"]:
    """Probability that a pixel's window holds nothing to match, or only glare."""
    luma = luminance(rendering.rgb)
    probability = np.zeros(luma.shape, np.float32)
    if config.fill_rate < 1.0:
        side = max(round(config.match_window_px / stereo_per_image), 1)
        bright = luma.astype(np.float32)
        mean = cv2.boxFilter(bright, -1, (side, side))
        variance = cv2.boxFilter(bright * bright, -1, (side, side)) - mean * mean
        depth_kernels.match_nothing(
            luma,
            np.asarray(variance, np.float32),
            rendering.depth,
            -np.log(1.0 - config.fill_rate) * config.fill_range_m**2 / config.fill_level,
            texture_features(config),
            probability,
        )
    if config.shiny_dropout > 0:
        glare = np.where(luma > SHINY_LUMINANCE, np.float32(config.shiny_dropout), np.float32(0))
        probability = np.maximum(probability, glare)
    return probability


def texture_features(config: StereoSensorConfig) -> Float32[np.ndarray, "256"]:
    """Pixels of a matching window expected to stand out of the noise, by contrast in levels.

    Of w² pixels whose brightness spreads by s, the share 2 Φ(−3 σ / s) differs from the mean by
    more than three times the imager's noise σ.
    """
    contrast = np.maximum(np.arange(256), 1e-3)
    noise = np.hypot(config.read_noise, np.sqrt(config.shot_noise * config.fill_level))
    share = 2.0 * ndtr(-3.0 * max(float(noise), 1.0) / contrast)
    return (config.match_window_px**2 * share).astype(np.float32)


def luminance(rgb: UInt8[np.ndarray, "H W 3"]) -> UInt8[np.ndarray, "H W"]:
    """Rec. 601 luma, what the infrared imagers see of the colour rendering."""
    return np.asarray(cv2.cvtColor(rgb, cv2.COLOR_RGB2GRAY))
