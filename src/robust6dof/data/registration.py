"""Depth of one camera seen from another: `register_depth`."""

from __future__ import annotations

from typing import no_type_check

import numba
import numpy as np
from jaxtyping import Float, Float32

# `no_type_check` below: the run-time shape checker must not wrap what numba compiles.

MAX_RELATIVE_STEP = 0.02
"""Neighbouring pixels whose depths differ by more than this share are not one surface."""
MIN_DEPTH_M = 1e-3
"""Points nearer to the target camera than this are not drawn [m]."""


def register_depth(
    depth: Float[np.ndarray, "H W"],
    K_depth: Float[np.ndarray, "3 3"],
    K_color: Float[np.ndarray, "3 3"],
    T_color_depth: Float[np.ndarray, "4 4"],
    color_size: tuple[int, int],
) -> Float32[np.ndarray, "Hc Wc"]:
    """Draw a depth image as the colour camera would have measured it.

    Neighbouring pixels of one surface are joined to triangles, drawn with a z-buffer and with
    1/z linear over the image: exact on planes, and dense when the colour image is the finer one.
    Lone pixels, and those at a border that the triangles leave out, fill the pixel they fall on.

    Args:
        depth: distance along the depth camera's axis [m]; 0 or not finite where invalid.
        K_depth: intrinsics of `depth` [px].
        K_color: intrinsics of the colour image [px].
        T_color_depth: depth-camera to colour-camera coordinates.
        color_size: width and height of the colour image [px].

    Returns:
        Distance along the colour camera's axis [m], 0 where nothing was seen.
    """
    width, height = color_size
    vertices = _project_grid(depth, K_depth, K_color, T_color_depth)
    inverse_depth, border = np.zeros((height, width)), np.zeros((height, width))
    _draw_surface(vertices, inverse_depth, border, 1.0 + MAX_RELATIVE_STEP)
    inverse_depth = np.where(inverse_depth > 0, inverse_depth, border)
    registered = np.zeros((height, width), dtype=np.float32)
    np.divide(1.0, inverse_depth, out=registered, where=inverse_depth > 0, casting="unsafe")
    return registered


def _project_grid(
    depth: np.ndarray, K_depth: np.ndarray, K_color: np.ndarray, T_color_depth: np.ndarray
) -> Float[np.ndarray, "H W 3"]:
    """Colour-image x, y [px] and 1/z [1/m] of every depth pixel; 1/z = 0 where invalid."""
    height, width = depth.shape
    x, y = np.meshgrid(np.arange(width, dtype=np.float64), np.arange(height, dtype=np.float64))
    rays = np.stack([x, y, np.ones_like(x)], axis=-1) @ np.linalg.inv(K_depth).T
    z = np.where(np.isfinite(depth) & (depth > 0), depth, 0.0).astype(np.float64)
    points_color = (rays * z[..., None]) @ T_color_depth[:3, :3].T + T_color_depth[:3, 3]
    drawn = (z > 0) & (points_color[..., 2] > MIN_DEPTH_M)
    points_color = np.where(drawn[..., None], points_color, [0.0, 0.0, 1.0])
    vertices = points_color @ K_color.T / points_color[..., 2:3]
    vertices[..., 2] = np.where(drawn, 1.0 / points_color[..., 2], 0.0)
    return vertices


@numba.njit(cache=True, nogil=True)
@no_type_check
def _draw_surface(vertices, inverse_depth, border, max_ratio):
    """Draw the grid [H, W, 3]: its surfaces and lone pixels into the z-buffer `inverse_depth`
    (nearest wins), and where the pixels of surfaces fall into `border`."""
    corners = np.empty((4, 3))
    height, width, _ = vertices.shape
    joined = np.zeros((height, width), dtype=np.bool_)
    for row in range(height - 1):
        for column in range(width - 1):
            for k in range(4):
                corners[k] = vertices[row + k // 2, column + k % 2]
            # Corners in reading order; leaving out 0 or 3 gives the two halves of the quad.
            smooth = _ratio(corners, 4) <= max_ratio
            for left_out in (3, 0, 1, 2):
                if not smooth and _ratio(corners, left_out) > max_ratio:
                    continue
                _draw_triangle(corners, left_out, inverse_depth)
                for k in range(4):
                    if k != left_out:
                        joined[row + k // 2, column + k % 2] = True
                if not smooth or left_out == 0:
                    break
    for row in range(height):
        for column in range(width):
            lone = not joined[row, column]
            _draw_point(vertices[row, column], inverse_depth if lone else border)


@numba.njit(cache=True, nogil=True)
@no_type_check
def _ratio(corners, left_out):
    """Farthest over nearest depth of the corners but one; infinite where one is invalid."""
    nearest, farthest = 0.0, np.inf
    for k in range(4):
        if k != left_out:
            nearest = max(nearest, corners[k, 2])
            farthest = min(farthest, corners[k, 2])
    return nearest / farthest if farthest > 0 else np.inf


@numba.njit(cache=True, nogil=True)
@no_type_check
def _draw_triangle(corners, left_out, inverse_depth):
    a = corners[0 if left_out != 0 else 1]
    b = corners[1 if left_out > 1 else 2]
    c = corners[3 if left_out != 3 else 2]
    area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    if abs(area) < 1e-12:
        return
    height, width = inverse_depth.shape
    x_first = max(0, int(np.ceil(min(a[0], b[0], c[0]) - 1e-9)))
    x_last = min(width - 1, int(np.floor(max(a[0], b[0], c[0]) + 1e-9)))
    y_first = max(0, int(np.ceil(min(a[1], b[1], c[1]) - 1e-9)))
    y_last = min(height - 1, int(np.floor(max(a[1], b[1], c[1]) + 1e-9)))
    for y in range(y_first, y_last + 1):
        for x in range(x_first, x_last + 1):
            weight_b = ((x - a[0]) * (c[1] - a[1]) - (y - a[1]) * (c[0] - a[0])) / area
            weight_c = ((b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0])) / area
            if weight_b < -1e-9 or weight_c < -1e-9 or weight_b + weight_c > 1.0 + 1e-9:
                continue
            value = a[2] + weight_b * (b[2] - a[2]) + weight_c * (c[2] - a[2])
            inverse_depth[y, x] = max(inverse_depth[y, x], value)


@numba.njit(cache=True, nogil=True)
@no_type_check
def _draw_point(vertex, inverse_depth):
    x, y = int(np.rint(vertex[0])), int(np.rint(vertex[1]))
    height, width = inverse_depth.shape
    if 0 <= x < width and 0 <= y < height:
        inverse_depth[y, x] = max(inverse_depth[y, x], vertex[2])
