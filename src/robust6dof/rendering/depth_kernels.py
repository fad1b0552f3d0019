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
def drop_occluded(disparity, stereo_per_image, left_limit, matched):
    """Set `matched` to 0 where the right imager sees something nearer, or nothing.

    A pixel x of the left image lies at x − d in the right one. It is hidden there if a pixel to
    its right lands at the same place or left of it, and lost if it falls off the left edge.
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
            # Half a stereo pixel of tolerance: smooth surfaces never hide themselves.
            if landing > leftmost + 0.5 or landing < left_limit:
                matched[row, column] = 0.0
            leftmost = min(leftmost, landing)


@njit(cache=True, nogil=True, error_model="numpy")
@no_type_check
def fatten(disparity, grown, growth, width_px, step_px, matched):
    """Take the disparity of a near surface within its random growth; `matched` is updated.

    Args:
        disparity: [H, W] the true disparity.
        grown: [R, H, W] its maxima within 1, 2, …, R pixels.
        growth: [H, W] random part of the growth [px].
        width_px: mean growth.
        step_px: smallest disparity step that is an outline; half of it where the pixel itself
            cannot be matched, so that rims which hide themselves are filled too.
        matched: [H, W] disparity; 0 where hidden.
    """
    n_radii = grown.shape[0]
    for row in range(matched.shape[0]):
        for column in range(matched.shape[1]):
            own = disparity[row, column]
            hidden = own > 0.0 and matched[row, column] == 0.0
            step = 0.5 * step_px if hidden else step_px
            if grown[n_radii - 1, row, column] - own <= step:
                continue
            radius = int(np.floor(width_px + growth[row, column] + 0.5))
            if hidden:
                radius = max(radius, 1)
            if radius < 1:
                continue
            near = grown[min(radius, n_radii) - 1, row, column]
            if near - own > step:
                matched[row, column] = near


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


@njit(cache=True, nogil=True, error_model="numpy")
@no_type_check
def match_nothing(luminance, variance, depth, spots, texture, probability):
    """Write the probability exp(−n) that a window holds none of the n features expected in it.

    Args:
        luminance: [H, W] uint8.
        variance: [H, W] float32 of the luminance in each pixel's window.
        depth: [H, W] float32 exact [m].
        spots: projected spots expected per level of luminance and 1/m².
        texture: [256] float32 features expected by the window's contrast in levels.
        probability: [H, W] float32; written.
    """
    for row in range(depth.shape[0]):
        for column in range(depth.shape[1]):
            z = depth[row, column]
            if z <= 0.0:
                continue
            contrast = min(int(np.sqrt(max(variance[row, column], 0.0)) + 0.5), 255)
            features = spots * luminance[row, column] / (z * z) + texture[contrast]
            probability[row, column] = np.exp(-features)


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
@no_type_check
def _surface_slope(before, here, after, step_px):
    """Change per pixel on the gentler side, and whether the other side steps off the surface."""
    back = here - before
    ahead = after - here
    gentler = back if np.abs(back) < np.abs(ahead) else ahead
    at_outline = np.abs(back + ahead - gentler) - np.abs(gentler) > step_px
    return gentler / _SLOPE_SPAN_PX, at_outline


@njit(cache=True, nogil=True, error_model="numpy")
@no_type_check
def drop_out(
    disparity,
    by_appearance,
    field,
    cosines,
    edge_dropout,
    step_px,
    K,
    thresholds,
    depth,
):
    """Set `depth` to 0 at grazing incidence, at outlines, and where appearance says so.

    Disparity is linear in the pixel on a plane, d = A x + B y + C, and the plane's normal is
    (f_x A, f_y B, d − A (x − c_x) − B (y − c_y)), which gives the angle of incidence.

    Args:
        disparity: [H, W] true disparity; 0 nothing.
        by_appearance: [H, W] dropout probability for want of light or texture.
        field: [H, W] Gaussian field of variance 1; a hole is where it is below Φ⁻¹(p).
        cosines: [2] of the angles at which dropouts begin and are complete.
        edge_dropout: dropout probability within the slope's span of an outline.
        step_px: a disparity step larger than this is an outline.
        K: [3, 3] intrinsics.
        thresholds: [N] Φ⁻¹ of probabilities from 0 to 1.
        depth: [H, W]; updated.
    """
    height, width = disparity.shape
    steps = thresholds.shape[0] - 1
    range_of_cosines = max(cosines[0] - cosines[1], 1e-9)
    by_geometry = cosines[0] > 1e-9 or edge_dropout > 0.0
    fx, fy = K[0, 0], K[1, 1]
    for row in range(height):
        y = row - K[1, 2]
        up, down = max(row - _SLOPE_SPAN_PX, 0), min(row + _SLOPE_SPAN_PX, height - 1)
        for column in range(width):
            d = disparity[row, column]
            if d <= 0.0 or depth[row, column] == 0.0:
                continue
            probability = by_appearance[row, column]
            if by_geometry:
                x = column - K[0, 2]
                left = max(column - _SLOPE_SPAN_PX, 0)
                right = min(column + _SLOPE_SPAN_PX, width - 1)
                a, steps_x = _surface_slope(disparity[row, left], d, disparity[row, right], step_px)
                b, steps_y = _surface_slope(
                    disparity[up, column], d, disparity[down, column], step_px
                )
                nx, ny, nz = fx * a, fy * b, d - a * x - b * y
                rx, ry = x / fx, y / fy
                lengths_sq = (nx * nx + ny * ny + nz * nz) * (rx * rx + ry * ry + 1.0)
                if steps_x or steps_y:
                    probability = max(probability, edge_dropout)
                elif d * d < cosines[0] * cosines[0] * lengths_sq:
                    grazing = (cosines[0] - d / np.sqrt(lengths_sq)) / range_of_cosines
                    probability = max(probability, min(grazing, 1.0))
            if probability > 0.0 and field[row, column] < thresholds[int(probability * steps)]:
                depth[row, column] = 0.0
