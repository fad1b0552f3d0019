"""The rasteriser's first compiled loop: coverage with a z-buffer.

Triangles are drawn in homogeneous form (Olano and Greer, "Triangle scan conversion using 2D
homogeneous coordinates", 1997): with corners a, b, c in the camera frame and a pixel's ray r
(r_z = 1), the edge functions are (b×c)·r, (c×a)·r, (a×b)·r and the inverse depth is n·r / n·a.
All are linear in the pixel, so a row's span follows from a few divisions, the near plane is one
more inequality, and nothing needs to be clipped. Shared edges give bitwise opposite functions in
both triangles, so meshes have no cracks.
"""

from __future__ import annotations

from typing import no_type_check

import numpy as np
from numba import njit

# Rows and columns are kept when a corner lies this close outside [px]: rounding only.
_EDGE_MARGIN_PX = 1e-6


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
@no_type_check
def cross(ax, ay, az, bx, by, bz):
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
@no_type_check
def to_pixel(nx, ny, nz, K_inv):
    """Coefficients (per x, per y, constant) of n·(K⁻¹ [x y 1]ᵀ)."""
    return (
        nx * K_inv[0, 0],
        nx * K_inv[0, 1] + ny * K_inv[1, 1],
        nx * K_inv[0, 2] + ny * K_inv[1, 2] + nz,
    )


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
@no_type_check
def _clip_span(slope, offset, low, high):
    """Part of [low, high] where slope · x + offset ≥ 0."""
    if slope > 0.0:
        low = max(low, -offset / slope)
    elif slope < 0.0:
        high = min(high, -offset / slope)
    elif offset < 0.0:
        high = -1.0
    return low, high


@njit(cache=True, nogil=True, error_model="numpy")
@no_type_check
def draw_depth(vertices_cam, faces, first, K, K_inv, near, inverse_depth, triangles):
    """Draw one mesh into the z-buffer.

    Args:
        vertices_cam: [V, 3] float64 in the camera frame [m].
        faces: [F, 3] int32.
        first: number written for face 0; face f writes first + f.
        K, K_inv: [3, 3] float64 intrinsics and their inverse [px].
        near: nothing closer than this is drawn [m].
        inverse_depth: [H, W] float64, 0 where empty; updated.
        triangles: [H, W] int32 number of the nearest triangle, 0 where empty; updated.
    """
    height, width = inverse_depth.shape
    for f in range(faces.shape[0]):
        i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
        ax, ay, az = vertices_cam[i, 0], vertices_cam[i, 1], vertices_cam[i, 2]
        bx, by, bz = vertices_cam[j, 0], vertices_cam[j, 1], vertices_cam[j, 2]
        cx, cy, cz = vertices_cam[k, 0], vertices_cam[k, 1], vertices_cam[k, 2]
        nearest = min(az, bz, cz)
        farthest = max(az, bz, cz)
        if not farthest > near:
            continue
        x_first, x_last = 0.0, width - 1.0
        y_first, y_last = 0.0, height - 1.0
        if nearest > near:
            au = (K[0, 0] * ax + K[0, 1] * ay) / az + K[0, 2]
            bu = (K[0, 0] * bx + K[0, 1] * by) / bz + K[0, 2]
            cu = (K[0, 0] * cx + K[0, 1] * cy) / cz + K[0, 2]
            av = K[1, 1] * ay / az + K[1, 2]
            bv = K[1, 1] * by / bz + K[1, 2]
            cv = K[1, 1] * cy / cz + K[1, 2]
            x_first = max(x_first, np.ceil(min(au, bu, cu) - _EDGE_MARGIN_PX))
            x_last = min(x_last, np.floor(max(au, bu, cu) + _EDGE_MARGIN_PX))
            y_first = max(y_first, np.ceil(min(av, bv, cv) - _EDGE_MARGIN_PX))
            y_last = min(y_last, np.floor(max(av, bv, cv) + _EDGE_MARGIN_PX))
        if not (x_first <= x_last and y_first <= y_last):
            continue

        nx, ny, nz = cross(bx - ax, by - ay, bz - az, cx - ax, cy - ay, cz - az)
        volume = nx * ax + ny * ay + nz * az
        if volume == 0.0 or not np.isfinite(volume):
            continue  # seen exactly edge-on, or without area
        side = 1.0 if volume > 0.0 else -1.0
        px, py, pz = cross(bx, by, bz, cx, cy, cz)
        e0x, e0y, e0c = to_pixel(side * px, side * py, side * pz, K_inv)
        px, py, pz = cross(cx, cy, cz, ax, ay, az)
        e1x, e1y, e1c = to_pixel(side * px, side * py, side * pz, K_inv)
        px, py, pz = cross(ax, ay, az, bx, by, bz)
        e2x, e2y, e2c = to_pixel(side * px, side * py, side * pz, K_inv)
        wx, wy, wc = to_pixel(nx / volume, ny / volume, nz / volume, K_inv)
        # Slivers seen nearly edge-on have an ill-conditioned plane: hold them between corners.
        w_min = 1.0 / farthest
        w_max = 1.0 / max(nearest, near)

        for row in range(int(y_first), int(y_last) + 1):
            y = float(row)
            low, high = _clip_span(e0x, e0y * y + e0c, x_first, x_last)
            low, high = _clip_span(e1x, e1y * y + e1c, low, high)
            low, high = _clip_span(e2x, e2y * y + e2c, low, high)
            w_row = wy * y + wc
            if nearest <= near:
                low, high = _clip_span(-wx, w_max - w_row, low, high)
            if not low <= high:
                continue
            for x in range(int(np.ceil(low)), int(np.floor(high)) + 1):
                w = min(max(wx * x + w_row, w_min), w_max)
                if w > inverse_depth[row, x]:
                    inverse_depth[row, x] = w
                    triangles[row, x] = first + f
