"""Compiled per-pixel loops of the stereo depth model. Disparities in pixels of the stereo pair."""

from __future__ import annotations

from typing import no_type_check

import numpy as np
from numba import njit

# Slopes are taken over about half a matching window, as the matcher sees them.
_SLOPE_SPAN_PX = 3


@njit(cache=True, nogil=True, error_model="numpy")
@no_type_check
def to_disparity(depth, focal_baseline):
    """[H, W] float32: focal · baseline / depth, 0 where there is nothing."""
    disparity = np.zeros_like(depth)
    for row in range(depth.shape[0]):
        for column in range(depth.shape[1]):
            if depth[row, column] > 0.0:
                disparity[row, column] = focal_baseline / depth[row, column]
    return disparity


@njit(cache=True, nogil=True, error_model="numpy")
@no_type_check
def fatten(grown, growth, width_px, step_px, matched):
    """Take the disparity of a near surface within its random growth; `matched` is updated.

    Args:
        grown: [R, H, W] maxima of the disparity within 1, 2, …, R pixels.
        growth: [H, W] random part of the growth [px].
        width_px: mean growth.
        step_px: smallest disparity step that is an outline.
        matched: [H, W] disparity.
    """
    n_radii = grown.shape[0]
    for row in range(matched.shape[0]):
        for column in range(matched.shape[1]):
            own = matched[row, column]
            if grown[n_radii - 1, row, column] - own <= step_px:
                continue
            radius = int(np.floor(width_px + growth[row, column] + 0.5))
            if radius < 1:
                continue
            near = grown[min(radius, n_radii) - 1, row, column]
            if near - own > step_px:
                matched[row, column] = near


@njit(cache=True, nogil=True, error_model="numpy")
@no_type_check
def drop_occluded(disparity, matched, stereo_per_image, left_limit):
    """Set `matched` to 0 where the right imager sees something nearer, or nothing.

    A pixel x of the left image lies at x − d in the right one. It is hidden there if a pixel to
    its right lands at the same place or left of it, and lost if it falls off the left edge.
    Pixels that took a near surface's disparity stay.
    """
    width = disparity.shape[1]
    for row in range(disparity.shape[0]):
        leftmost = np.inf
        for i in range(width):
            column = width - 1 - i
            d = disparity[row, column]
            if d <= 0.0:
                continue
            landing = column * stereo_per_image - d
            if matched[row, column] == d:
                # Half a stereo pixel of tolerance: smooth surfaces never hide themselves.
                if landing > leftmost + 0.5 or landing < left_limit:
                    matched[row, column] = 0.0
            elif column * stereo_per_image - matched[row, column] < left_limit:
                matched[row, column] = 0.0
            leftmost = min(leftmost, landing)


@njit(cache=True, nogil=True, error_model="numpy")
@no_type_check
def measure(
    exact,
    disparity,
    matched,
    noise,
    focal_baseline,
    largest,
    smallest,
    step_px,
    unit_m,
    depth,
):
    """Add noise to the matched disparity, quantise, limit the range and triangulate.

    Args:
        exact, disparity: [H, W] the true depth [m] and disparity.
        matched: [H, W] disparity after fattening and occlusion; 0 invalid.
        noise: [H, W] added disparity.
        largest, smallest: limits of the disparity.
        step_px, unit_m: steps of disparity and depth; 0 continuous.
        depth: [H, W] float32; written.
    """
    for row in range(depth.shape[0]):
        for column in range(depth.shape[1]):
            d = matched[row, column]
            if d <= 0.0 or d > largest or d < smallest:
                depth[row, column] = 0.0
                continue
            z = np.float64(exact[row, column])
            measured = np.float64(d) + noise[row, column]
            if step_px > 0.0:
                measured = np.floor(measured / step_px + 0.5) * step_px
            if measured != disparity[row, column]:
                z = focal_baseline / measured if measured > 0.0 else 0.0
            if unit_m > 0.0:
                z = np.floor(z / unit_m + 0.5) * unit_m
            depth[row, column] = z


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
@no_type_check
def _inner_slope(before, here, after):
    """Change per pixel towards the side where it is smaller: the surface's, not its outline's."""
    back = here - before
    ahead = after - here
    if before <= 0.0 or (after > 0.0 and np.abs(ahead) < np.abs(back)):
        return ahead / _SLOPE_SPAN_PX if after > 0.0 else 0.0
    return back / _SLOPE_SPAN_PX


@njit(cache=True, nogil=True, error_model="numpy")
@no_type_check
def drop_out(disparity, luminance, field, by_luminance, cosines, K, thresholds, depth):
    """Set `depth` to 0 at grazing incidence, on dark and on shiny surfaces, and here and there.

    Disparity is linear in the pixel on a plane, d = A x + B y + C, and the plane's normal is
    (f_x A, f_y B, d − A (x − c_x) − B (y − c_y)), which gives the angle of incidence.

    Args:
        disparity: [H, W] true disparity; 0 nothing.
        luminance: [H, W] uint8.
        field: [H, W] Gaussian field of variance 1; a hole is where it is below Φ⁻¹(p).
        by_luminance: [256] dropout probability.
        cosines: [2] of the angles at which dropouts begin and are complete.
        K: [3, 3] intrinsics.
        thresholds: [N] Φ⁻¹ of probabilities from 0 to 1.
        depth: [H, W]; updated.
    """
    height, width = disparity.shape
    steps = thresholds.shape[0] - 1
    range_of_cosines = max(cosines[0] - cosines[1], 1e-9)
    fx, fy = K[0, 0], K[1, 1]
    for row in range(height):
        y = row - K[1, 2]
        up, down = max(row - _SLOPE_SPAN_PX, 0), min(row + _SLOPE_SPAN_PX, height - 1)
        for column in range(width):
            d = disparity[row, column]
            if d <= 0.0 or depth[row, column] == 0.0:
                continue
            probability = by_luminance[luminance[row, column]]
            if cosines[0] > 1e-9:
                x = column - K[0, 2]
                left, right = (
                    max(column - _SLOPE_SPAN_PX, 0),
                    min(column + _SLOPE_SPAN_PX, width - 1),
                )
                a = _inner_slope(disparity[row, left], d, disparity[row, right])
                b = _inner_slope(disparity[up, column], d, disparity[down, column])
                nx, ny, nz = fx * a, fy * b, d - a * x - b * y
                rx, ry = x / fx, y / fy
                lengths_sq = (nx * nx + ny * ny + nz * nz) * (rx * rx + ry * ry + 1.0)
                if d * d < cosines[0] * cosines[0] * lengths_sq:
                    grazing = (cosines[0] - d / np.sqrt(lengths_sq)) / range_of_cosines
                    probability = max(probability, min(grazing, 1.0))
            if probability > 0.0 and field[row, column] < thresholds[int(probability * steps)]:
                depth[row, column] = 0.0
