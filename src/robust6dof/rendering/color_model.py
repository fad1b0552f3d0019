"""Exact colour to what a colour camera records: lens, motion, exposure, noise.

Formulas and sources: docs/sensor-model.md.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

import cv2
import numpy as np
from jaxtyping import Float, Float32, UInt8

from robust6dof.rendering import color_kernels
from robust6dof.rendering.scene import Rendering
from robust6dof.rendering.sensor_config import StereoSensorConfig

STILL = 0
"""Stands for all that does not move, as the background's id."""
_BACKGROUND_RANGE_M = 1000.0


def observe_color(
    rendering: Rendering,
    K: Float[np.ndarray, "3 3"],
    config: StereoSensorConfig,
    rng: np.random.Generator,
    twists: Mapping[int, Float[np.ndarray, "6"]] = MappingProxyType({}),
    exposure_s: float = 0.0,
) -> UInt8[np.ndarray, "H W 3"]:
    """The image as recorded with the camera in motion; `twists` as for `blur_by_motion`."""
    rgb = rendering.rgb
    if config.psf_sigma_px > 0:
        rgb = np.asarray(cv2.GaussianBlur(rgb, (0, 0), config.psf_sigma_px))
    if twists and (exposure_s > 0 or config.readout_s > 0):
        rgb = blur_by_motion(replace(rendering, rgb=rgb), K, twists, exposure_s, config.readout_s)
    gains = config.exposure_gain * np.array(config.white_balance, np.float64)
    if config.shot_noise <= 0 and config.read_noise <= 0 and (gains == 1.0).all():
        return rgb.copy()
    means, sigmas = _exposure_tables(gains, config)
    noisy = np.empty_like(rgb)
    seed = np.uint64(rng.integers(0, 2**63))
    color_kernels.expose(np.ascontiguousarray(rgb), means, sigmas, seed, noisy)
    return noisy


def blur_by_motion(
    rendering: Rendering,
    K: Float[np.ndarray, "3 3"],
    twists: Mapping[int, Float[np.ndarray, "6"]],
    exposure_s: float,
    readout_s: float = 0.0,
) -> UInt8[np.ndarray, "H W 3"]:
    """Average the image along each pixel's own path during the exposure.

    The path is straight, with the velocity that the point seen there has in the image (interaction
    matrix of a point: Chaumette and Hutchinson, "Visual servo control I", 2006). A rotation
    needs no depth; at an outline the path is that of the pixel's own surface. With a rolling
    shutter, row y is exposed (y / H − ½) · readout later than the frame's middle.

    Args:
        rendering: colour, depth and ids at the middle of the exposure.
        K: intrinsics.
        twists: velocity of the camera in its own frame, linear [m/s] then angular [rad/s]: relative
            to what stands still under `STILL`, relative to each moving thing under its id.
        exposure_s, readout_s: shutter time, and time from the first to the last row.
    """
    depth = rendering.depth
    blurred = np.empty_like(rendering.rgb)
    depth = np.where(depth > 0, depth, np.float32(_BACKGROUND_RANGE_M))
    moving = [number for number in twists if number != STILL]
    which = np.zeros(depth.shape, np.uint8)
    for place, number in enumerate(moving, start=1):
        which[rendering.ids == number] = place
    color_kernels.average_along_flow(
        np.ascontiguousarray(rendering.rgb),
        depth,
        which,
        np.asarray(K, np.float64),
        np.array([twists[number] for number in (STILL, *moving)], np.float64),
        float(exposure_s),
        float(readout_s),
        blurred,
    )
    return blurred


def _exposure_tables(
    gains: Float[np.ndarray, "3"], config: StereoSensorConfig
) -> tuple[Float32[np.ndarray, "3 256"], Float32[np.ndarray, "3 256"]]:
    """Mean and standard deviation of the recorded level for each channel and exact level."""
    means = gains[:, None] * np.arange(256)
    sigmas = np.sqrt(config.shot_noise * np.minimum(means, 255.0) + config.read_noise**2)
    return means.astype(np.float32), sigmas.astype(np.float32)
