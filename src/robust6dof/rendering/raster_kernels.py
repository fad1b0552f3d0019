"""The two compiled loops of the rasteriser: coverage with a z-buffer, then shading.

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
def _cross(ax, ay, az, bx, by, bz):
    return ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
@no_type_check
def _to_pixel(nx, ny, nz, K_inv):
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

        nx, ny, nz = _cross(bx - ax, by - ay, bz - az, cx - ax, cy - ay, cz - az)
        volume = nx * ax + ny * ay + nz * az
        if volume == 0.0 or not np.isfinite(volume):
            continue  # seen exactly edge-on, or without area
        side = 1.0 if volume > 0.0 else -1.0
        px, py, pz = _cross(bx, by, bz, cx, cy, cz)
        e0x, e0y, e0c = _to_pixel(side * px, side * py, side * pz, K_inv)
        px, py, pz = _cross(cx, cy, cz, ax, ay, az)
        e1x, e1y, e1c = _to_pixel(side * px, side * py, side * pz, K_inv)
        px, py, pz = _cross(ax, ay, az, bx, by, bz)
        e2x, e2y, e2c = _to_pixel(side * px, side * py, side * pz, K_inv)
        wx, wy, wc = _to_pixel(nx / volume, ny / volume, nz / volume, K_inv)
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


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
@no_type_check
def _integer_power(base, exponent):
    result = 1.0
    while exponent > 0:
        if exponent & 1:
            result *= base
        base *= base
        exponent >>= 1
    return result


@njit(cache=True, nogil=True, error_model="numpy", inline="always")
@no_type_check
def _sample_texture(texels, levels, footprint_sq, u, v):
    """Bilinear colour at (u, v), from the level whose texels are as large as the pixel."""
    level = 0
    while footprint_sq > 2.0 and level < levels.shape[0] - 1:
        footprint_sq *= 0.25
        level += 1
    start, height, width = levels[level, 0], levels[level, 1], levels[level, 2]
    x = (u - np.floor(u)) * width - 0.5
    y = (1.0 - (v - np.floor(v))) * height - 0.5
    x_floor = np.floor(x)
    y_floor = np.floor(y)
    fx, fy = x - x_floor, y - y_floor
    x0, y0 = int(x_floor), int(y_floor)
    x1 = x0 + 1 if x0 + 1 < width else 0
    y1 = y0 + 1 if y0 + 1 < height else 0
    x0 = x0 if x0 >= 0 else width - 1
    y0 = y0 if y0 >= 0 else height - 1
    p00, p01 = start + y0 * width + x0, start + y0 * width + x1
    p10, p11 = start + y1 * width + x0, start + y1 * width + x1
    w00, w01 = (1.0 - fx) * (1.0 - fy), fx * (1.0 - fy)
    w10, w11 = (1.0 - fx) * fy, fx * fy
    red = w00 * texels[p00, 0] + w01 * texels[p01, 0] + w10 * texels[p10, 0] + w11 * texels[p11, 0]
    green = (
        w00 * texels[p00, 1] + w01 * texels[p01, 1] + w10 * texels[p10, 1] + w11 * texels[p11, 1]
    )
    blue = w00 * texels[p00, 2] + w01 * texels[p01, 2] + w10 * texels[p10, 2] + w11 * texels[p11, 2]
    return red, green, blue


@njit(cache=True, nogil=True, error_model="numpy", fastmath={"contract", "nsz", "arcp"})
@no_type_check
def shade(
    triangles,
    inverse_depth,
    first,
    rows,
    columns,
    vertices_cam,
    faces,
    corner_uv,
    corner_normals,
    texel_density,
    texels,
    levels,
    rays_mesh,
    K_inv,
    light_directions,
    light_colors,
    ambient,
    specular,
    half_shininess,
    rgb,
):
    """Colour the pixels of one mesh: Lambert and Blinn-Phong, light by light, per pixel.

    Args:
        triangles, inverse_depth: what `draw_depth` left.
        first: number of this mesh's face 0.
        rows, columns: [2] int64 first and last-plus-one of the part of the image to visit.
        vertices_cam, faces: as for `draw_depth`.
        corner_uv: [F, 3, 2] float32; corner_normals: [F, 3, 3] float32, unit, mesh frame.
        texel_density: [F] float32, texels per metre on each face.
        texels: [P, 3] uint8, all levels of the texture; levels: [L, 3] int64 (start, h, w).
        rays_mesh: [3, 3] matrix from pixel (x, y, 1) to the viewing ray in the mesh frame.
        K_inv: [3, 3].
        light_directions: [L, 3] unit vectors towards the lights, mesh frame.
        light_colors: [L, 3]; ambient: [3]; specular: strength of the highlight.
        half_shininess: integer; the highlight is (n·h)^(2 · half_shininess).
        rgb: [H, W, 3] uint8; updated.
    """
    last = -1
    n_faces = faces.shape[0]
    n_lights = light_directions.shape[0]
    cutoff_sq = min(0.5 / (255.0 * max(specular, 1e-9)), 1.0) ** (1.0 / half_shininess)
    pixel_size = np.sqrt(np.abs(K_inv[0, 0] * K_inv[1, 1]))
    e0x = e0y = e0c = e1x = e1y = e1c = e2x = e2y = e2c = 0.0
    facing = 1.0
    for row in range(rows[0], rows[1]):
        y = float(row)
        for column in range(columns[0], columns[1]):
            f = triangles[row, column] - first
            if f < 0 or f >= n_faces:
                continue
            x = float(column)
            if f != last:
                last = f
                i, j, k = faces[f, 0], faces[f, 1], faces[f, 2]
                ax, ay, az = vertices_cam[i, 0], vertices_cam[i, 1], vertices_cam[i, 2]
                bx, by, bz = vertices_cam[j, 0], vertices_cam[j, 1], vertices_cam[j, 2]
                cx, cy, cz = vertices_cam[k, 0], vertices_cam[k, 1], vertices_cam[k, 2]
                px, py, pz = _cross(bx, by, bz, cx, cy, cz)
                facing = -1.0 if px * ax + py * ay + pz * az > 0.0 else 1.0
                e0x, e0y, e0c = _to_pixel(px, py, pz, K_inv)
                px, py, pz = _cross(cx, cy, cz, ax, ay, az)
                e1x, e1y, e1c = _to_pixel(px, py, pz, K_inv)
                px, py, pz = _cross(ax, ay, az, bx, by, bz)
                e2x, e2y, e2c = _to_pixel(px, py, pz, K_inv)
            # Barycentric weights; every edge function has the sign of `facing`.
            b0 = max(-facing * (e0x * x + e0y * y + e0c), 0.0)
            b1 = max(-facing * (e1x * x + e1y * y + e1c), 0.0)
            b2 = max(-facing * (e2x * x + e2y * y + e2c), 0.0)
            total = b0 + b1 + b2
            if not total > 0.0:
                b0 = b1 = b2 = total = 1.0 / 3.0
                total = 1.0
            scale = 1.0 / total
            b0, b1, b2 = b0 * scale, b1 * scale, b2 * scale

            nx = b0 * corner_normals[f, 0, 0] + b1 * corner_normals[f, 1, 0]
            ny = b0 * corner_normals[f, 0, 1] + b1 * corner_normals[f, 1, 1]
            nz = b0 * corner_normals[f, 0, 2] + b1 * corner_normals[f, 1, 2]
            nx += b2 * corner_normals[f, 2, 0]
            ny += b2 * corner_normals[f, 2, 1]
            nz += b2 * corner_normals[f, 2, 2]
            scale = facing / np.sqrt(max(nx * nx + ny * ny + nz * nz, 1e-20))
            nx, ny, nz = nx * scale, ny * scale, nz * scale
            vx = -(rays_mesh[0, 0] * x + rays_mesh[0, 1] * y + rays_mesh[0, 2])
            vy = -(rays_mesh[1, 0] * x + rays_mesh[1, 1] * y + rays_mesh[1, 2])
            vz = -(rays_mesh[2, 0] * x + rays_mesh[2, 1] * y + rays_mesh[2, 2])
            scale = 1.0 / np.sqrt(vx * vx + vy * vy + vz * vz)
            vx, vy, vz = vx * scale, vy * scale, vz * scale

            slant = max(np.abs(nx * vx + ny * vy + nz * vz), 0.05)
            footprint = texel_density[f] * pixel_size
            footprint_sq = footprint * footprint / (inverse_depth[row, column] ** 2 * slant)
            u = b0 * corner_uv[f, 0, 0] + b1 * corner_uv[f, 1, 0] + b2 * corner_uv[f, 2, 0]
            v = b0 * corner_uv[f, 0, 1] + b1 * corner_uv[f, 1, 1] + b2 * corner_uv[f, 2, 1]
            red, green, blue = _sample_texture(texels, levels, footprint_sq, u, v)

            diffuse_r, diffuse_g, diffuse_b = ambient[0], ambient[1], ambient[2]
            gloss_r = gloss_g = gloss_b = 0.0
            for light in range(n_lights):
                lx = light_directions[light, 0]
                ly = light_directions[light, 1]
                lz = light_directions[light, 2]
                lambert = nx * lx + ny * ly + nz * lz
                if lambert <= 0.0:
                    continue
                diffuse_r += lambert * light_colors[light, 0]
                diffuse_g += lambert * light_colors[light, 1]
                diffuse_b += lambert * light_colors[light, 2]
                # (n·h)² without a root; below the cut-off the highlight is under half a level.
                hx, hy, hz = lx + vx, ly + vy, lz + vz
                along = nx * hx + ny * hy + nz * hz
                half_sq = hx * hx + hy * hy + hz * hz
                if along > 0.0 and along * along > cutoff_sq * half_sq:
                    power = _integer_power(along * along / half_sq, half_shininess)
                    gloss_r += 255.0 * specular * power * light_colors[light, 0]
                    gloss_g += 255.0 * specular * power * light_colors[light, 1]
                    gloss_b += 255.0 * specular * power * light_colors[light, 2]
            rgb[row, column, 0] = np.uint8(min(red * diffuse_r + gloss_r + 0.5, 255.0))
            rgb[row, column, 1] = np.uint8(min(green * diffuse_g + gloss_g + 0.5, 255.0))
            rgb[row, column, 2] = np.uint8(min(blue * diffuse_b + gloss_b + 0.5, 255.0))
