"""The rasteriser's second compiled loop: the colour of what `raster_kernels` found visible.

Its parts are inlined into the loop, which is as fast as when they were written out there.
"""

from __future__ import annotations

from typing import no_type_check

import numpy as np
from numba import njit

from robust6dof.rendering.raster_kernels import cross, to_pixel

_FASTMATH = {"contract", "nsz", "arcp"}


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


@njit(cache=True, nogil=True, error_model="numpy", fastmath=_FASTMATH, inline="always")
@no_type_check
def _edge_functions(vertices_cam, face, K_inv):
    """The sign that all have inside the triangle, then the coefficients of the three."""
    ax, ay, az = vertices_cam[face[0], 0], vertices_cam[face[0], 1], vertices_cam[face[0], 2]
    bx, by, bz = vertices_cam[face[1], 0], vertices_cam[face[1], 1], vertices_cam[face[1], 2]
    cx, cy, cz = vertices_cam[face[2], 0], vertices_cam[face[2], 1], vertices_cam[face[2], 2]
    px, py, pz = cross(bx, by, bz, cx, cy, cz)
    facing = -1.0 if px * ax + py * ay + pz * az > 0.0 else 1.0
    e0x, e0y, e0c = to_pixel(px, py, pz, K_inv)
    px, py, pz = cross(cx, cy, cz, ax, ay, az)
    e1x, e1y, e1c = to_pixel(px, py, pz, K_inv)
    px, py, pz = cross(ax, ay, az, bx, by, bz)
    e2x, e2y, e2c = to_pixel(px, py, pz, K_inv)
    return facing, e0x, e0y, e0c, e1x, e1y, e1c, e2x, e2y, e2c


@njit(cache=True, nogil=True, error_model="numpy", fastmath=_FASTMATH, inline="always")
@no_type_check
def _barycentric(edges, x, y):
    """Weights of the three corners at a pixel, none negative."""
    facing, e0x, e0y, e0c, e1x, e1y, e1c, e2x, e2y, e2c = edges
    b0 = max(-facing * (e0x * x + e0y * y + e0c), 0.0)
    b1 = max(-facing * (e1x * x + e1y * y + e1c), 0.0)
    b2 = max(-facing * (e2x * x + e2y * y + e2c), 0.0)
    total = b0 + b1 + b2
    if not total > 0.0:
        return 1.0 / 3.0, 1.0 / 3.0, 1.0 / 3.0
    scale = 1.0 / total
    return b0 * scale, b1 * scale, b2 * scale


@njit(cache=True, nogil=True, error_model="numpy", fastmath=_FASTMATH, inline="always")
@no_type_check
def _unit(x, y, z):
    scale = 1.0 / np.sqrt(max(x * x + y * y + z * z, 1e-20))
    return x * scale, y * scale, z * scale


@njit(cache=True, nogil=True, error_model="numpy", fastmath=_FASTMATH, inline="always")
@no_type_check
def _normal(corner_normals, f, weights, facing):
    """Unit normal on the camera's side."""
    b0, b1, b2 = weights
    nx = b0 * corner_normals[f, 0, 0] + b1 * corner_normals[f, 1, 0]
    ny = b0 * corner_normals[f, 0, 1] + b1 * corner_normals[f, 1, 1]
    nz = b0 * corner_normals[f, 0, 2] + b1 * corner_normals[f, 1, 2]
    nx += b2 * corner_normals[f, 2, 0]
    ny += b2 * corner_normals[f, 2, 1]
    nz += b2 * corner_normals[f, 2, 2]
    nx, ny, nz = _unit(nx, ny, nz)
    return facing * nx, facing * ny, facing * nz


@njit(cache=True, nogil=True, error_model="numpy", fastmath=_FASTMATH, inline="always")
@no_type_check
def _towards_camera(rays_mesh, x, y):
    """Unit vector from the pixel's surface to the camera."""
    return _unit(
        -(rays_mesh[0, 0] * x + rays_mesh[0, 1] * y + rays_mesh[0, 2]),
        -(rays_mesh[1, 0] * x + rays_mesh[1, 1] * y + rays_mesh[1, 2]),
        -(rays_mesh[2, 0] * x + rays_mesh[2, 1] * y + rays_mesh[2, 2]),
    )


@njit(cache=True, nogil=True, error_model="numpy", fastmath=_FASTMATH, inline="always")
@no_type_check
def _light_up(normal, view, directions, colors, ambient, specular, half_shininess, cutoff_sq):
    """Diffuse red, green, blue (factors) and those of the highlight (levels)."""
    nx, ny, nz = normal
    vx, vy, vz = view
    diffuse_r, diffuse_g, diffuse_b = ambient[0], ambient[1], ambient[2]
    gloss_r = gloss_g = gloss_b = 0.0
    for light in range(directions.shape[0]):
        lx, ly, lz = directions[light, 0], directions[light, 1], directions[light, 2]
        lambert = nx * lx + ny * ly + nz * lz
        if lambert <= 0.0:
            continue
        diffuse_r += lambert * colors[light, 0]
        diffuse_g += lambert * colors[light, 1]
        diffuse_b += lambert * colors[light, 2]
        # (n·h)² without a root; below the cut-off the highlight is under half a level.
        hx, hy, hz = lx + vx, ly + vy, lz + vz
        along = nx * hx + ny * hy + nz * hz
        half_sq = hx * hx + hy * hy + hz * hz
        if along > 0.0 and along * along > cutoff_sq * half_sq:
            power = _integer_power(along * along / half_sq, half_shininess)
            gloss_r += 255.0 * specular * power * colors[light, 0]
            gloss_g += 255.0 * specular * power * colors[light, 1]
            gloss_b += 255.0 * specular * power * colors[light, 2]
    return diffuse_r, diffuse_g, diffuse_b, gloss_r, gloss_g, gloss_b


@njit(cache=True, nogil=True, error_model="numpy", fastmath=_FASTMATH)
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
    cutoff_sq = min(0.5 / (255.0 * max(specular, 1e-9)), 1.0) ** (1.0 / half_shininess)
    pixel_size = np.sqrt(np.abs(K_inv[0, 0] * K_inv[1, 1]))
    edges = (1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    for row in range(rows[0], rows[1]):
        y = float(row)
        for column in range(columns[0], columns[1]):
            f = triangles[row, column] - first
            if f < 0 or f >= faces.shape[0]:
                continue
            x = float(column)
            if f != last:
                last = f
                edges = _edge_functions(vertices_cam, faces[f], K_inv)
            weights = _barycentric(edges, x, y)
            nx, ny, nz = _normal(corner_normals, f, weights, edges[0])
            vx, vy, vz = _towards_camera(rays_mesh, x, y)

            slant = max(np.abs(nx * vx + ny * vy + nz * vz), 0.05)
            footprint = texel_density[f] * pixel_size
            footprint_sq = footprint * footprint / (inverse_depth[row, column] ** 2 * slant)
            b0, b1, b2 = weights
            u = b0 * corner_uv[f, 0, 0] + b1 * corner_uv[f, 1, 0] + b2 * corner_uv[f, 2, 0]
            v = b0 * corner_uv[f, 0, 1] + b1 * corner_uv[f, 1, 1] + b2 * corner_uv[f, 2, 1]
            red, green, blue = _sample_texture(texels, levels, footprint_sq, u, v)
            diffuse_r, diffuse_g, diffuse_b, gloss_r, gloss_g, gloss_b = _light_up(
                (nx, ny, nz),
                (vx, vy, vz),
                light_directions,
                light_colors,
                ambient,
                specular,
                half_shininess,
                cutoff_sq,
            )
            rgb[row, column, 0] = np.uint8(min(red * diffuse_r + gloss_r + 0.5, 255.0))
            rgb[row, column, 1] = np.uint8(min(green * diffuse_g + gloss_g + 0.5, 255.0))
            rgb[row, column, 2] = np.uint8(min(blue * diffuse_b + gloss_b + 0.5, 255.0))
