"""Compiled per-pixel loops of the colour camera model."""

from __future__ import annotations

from typing import no_type_check

import numpy as np
from numba import njit

# Bilinear samples this far apart, after the lens's blur, leave no visible steps.
_TAP_SPACING_PX = 1.5


@njit(cache=True, nogil=True, error_model="numpy")
@no_type_check
def average_along_flow(rgb, depth, which, K, twists, exposure_s, readout_s, blurred):
    """Mean of bilinear samples along each pixel's path; see `blur_by_motion`.

    Args:
        rgb: [H, W, 3] uint8 at the middle of the exposure.
        depth: [H, W] float32 [m], positive.
        which: [H, W] uint8 row of `twists` that holds for each pixel.
        K: [3, 3]; twists: [T, 6] linear and angular velocities of the camera in its frame.
        exposure_s, readout_s: shutter time and time from the first to the last row.
        blurred: [H, W, 3] uint8; written.
    """
    height, width = depth.shape
    fx, fy, cx, cy = K[0, 0], K[1, 1], K[0, 2], K[1, 2]
    for row in range(height):
        y = (row - cy) / fy
        delay = (row / height - 0.5) * readout_s
        for column in range(width):
            x = (column - cx) / fx
            w = 1.0 / depth[row, column]
            k = which[row, column]
            vx, vy, vz = twists[k, 0], twists[k, 1], twists[k, 2]
            wx, wy, wz = twists[k, 3], twists[k, 4], twists[k, 5]
            flow_x = fx * ((x * vz - vx) * w + x * y * wx - (1.0 + x * x) * wy + y * wz)
            flow_y = fy * ((y * vz - vy) * w + (1.0 + y * y) * wx - x * y * wy - x * wz)
            length = exposure_s * np.sqrt(flow_x * flow_x + flow_y * flow_y)
            samples = min(int(length / _TAP_SPACING_PX) + 1, 64)
            # What is seen here at time t was at the middle of the exposure t · flow back.
            first = delay + exposure_s * (0.5 / samples - 0.5)
            step = exposure_s / samples
            # Positions in 1/256 px, as integers.
            u = np.int64(256.0 * (column - first * flow_x) + 0.5)
            v = np.int64(256.0 * (row - first * flow_y) + 0.5)
            step_u = np.int64(np.floor(-256.0 * step * flow_x + 0.5))
            step_v = np.int64(np.floor(-256.0 * step * flow_y + 0.5))
            red = green = blue = 0
            for _ in range(samples):
                left = min(max(u >> 8, 0), width - 2)
                top = min(max(v >> 8, 0), height - 2)
                a = min(max(u - (left << 8), 0), 256)
                b = min(max(v - (top << 8), 0), 256)
                w11 = a * b
                w01 = (a << 8) - w11
                w10 = (b << 8) - w11
                w00 = 65536 - w01 - w10 - w11
                red += w00 * rgb[top, left, 0] + w01 * rgb[top, left + 1, 0]
                red += w10 * rgb[top + 1, left, 0] + w11 * rgb[top + 1, left + 1, 0]
                green += w00 * rgb[top, left, 1] + w01 * rgb[top, left + 1, 1]
                green += w10 * rgb[top + 1, left, 1] + w11 * rgb[top + 1, left + 1, 1]
                blue += w00 * rgb[top, left, 2] + w01 * rgb[top, left + 1, 2]
                blue += w10 * rgb[top + 1, left, 2] + w11 * rgb[top + 1, left + 1, 2]
                u += step_u
                v += step_v
            scale = 1.0 / (65536.0 * samples)
            blurred[row, column, 0] = np.uint8(red * scale + 0.5)
            blurred[row, column, 1] = np.uint8(green * scale + 0.5)
            blurred[row, column, 2] = np.uint8(blue * scale + 0.5)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
@no_type_check
def _random_bits(counter):
    """SplitMix64 (Steele, Lea and Flood, 2014) of a 64-bit counter."""
    z = counter * np.uint64(0x9E3779B97F4A7C15)
    z = (z ^ (z >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    z = (z ^ (z >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    return z ^ (z >> np.uint64(31))


@njit(cache=True, nogil=True, error_model="numpy")
@no_type_check
def expose(rgb, means, sigmas, seed, noisy):
    """Draw each recorded level from its mean and standard deviation.

    The noise is the sum of four uniform 16-bit numbers (Irwin–Hall), which is Gaussian up to 3 σ.

    Args:
        rgb: [H, W, 3] uint8 exact.
        means, sigmas: [3, 256] float32 by channel and exact level.
        seed: uint64.
        noisy: [H, W, 3] uint8; written.
    """
    low16 = np.uint64(0xFFFF)
    centre = np.float32(2.0 * 65535.0)
    scale = np.float32(1.0 / (65536.0 * np.sqrt(4.0 / 12.0)))
    counter = seed
    for row in range(rgb.shape[0]):
        for column in range(rgb.shape[1]):
            for channel in range(3):
                counter += np.uint64(1)
                z = _random_bits(counter)
                total = (
                    (z & low16)
                    + ((z >> np.uint64(16)) & low16)
                    + ((z >> np.uint64(32)) & low16)
                    + (z >> np.uint64(48))
                )
                level = rgb[row, column, channel]
                noise = (np.float32(np.int64(total)) - centre) * scale
                value = means[channel, level] + sigmas[channel, level] * noise
                noisy[row, column, channel] = np.uint8(min(max(value + 0.5, 0.0), 255.0))
