"""Boxes, cylinders and tubes as textured meshes: furniture and the vehicle's looks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float, UInt8
from scipy.spatial.transform import Rotation

from robust6dof.geometry.transforms import make_transform, transform_points
from robust6dof.shapes.mesh import Material, TexturedMesh

_MATT = Material(specular=0.05, shininess=10.0)


def plain(red: int, green: int, blue: int) -> UInt8[np.ndarray, "1 1 3"]:
    """A texture of one colour."""
    return np.array([[[red, green, blue]]], dtype=np.uint8)


def box(
    size: Sequence[float],
    texture: UInt8[np.ndarray, "Th Tw 3"],
    *,
    tile: float = 1.0,
    material: Material = _MATT,
) -> TexturedMesh:
    """A box of `size` [m] about the origin; the texture repeats every `tile` metres."""
    vertices, faces, uv = [], [], []
    for axis in range(3):
        for sign in (1.0, -1.0):
            u_axis, v_axis = (axis + 1) % 3, (axis + 2) % 3
            square = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) / 2.0
            corners = np.zeros((4, 3))
            corners[:, axis] = sign * size[axis] / 2.0
            corners[:, u_axis] = square[:, 0] * sign * size[u_axis]
            corners[:, v_axis] = square[:, 1] * size[v_axis]
            first = 4 * len(vertices)
            faces += [[first, first + 1, first + 2], [first, first + 2, first + 3]]
            vertices.append(corners)
            uv.append(corners[:, [u_axis, v_axis]] / tile)
    return TexturedMesh(
        np.concatenate(vertices), np.array(faces), np.concatenate(uv), texture, material
    )


def cylinder(
    radius: float,
    height: float,
    texture: UInt8[np.ndarray, "Th Tw 3"],
    *,
    sides: int = 20,
    tile: float = 1.0,
    material: Material = _MATT,
) -> TexturedMesh:
    """A cylinder along z about the origin."""
    angle = np.linspace(0.0, 2.0 * np.pi, sides + 1)
    ring = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    low = np.column_stack([ring, np.full(sides + 1, -height / 2.0)])
    high = np.column_stack([ring, np.full(sides + 1, height / 2.0)])
    caps = [np.array([[0.0, 0.0, z]]) for z in (-height / 2.0, height / 2.0)]
    vertices = np.concatenate([low, high, low, high, *caps])
    n = sides + 1
    i = np.arange(sides)
    side = np.concatenate(
        [np.stack([i, i + 1, n + i + 1], axis=1), np.stack([i, n + i + 1, n + i], axis=1)]
    )
    bottom = np.stack([2 * n + i + 1, 2 * n + i, np.full(sides, 4 * n)], axis=1)
    top = np.stack([3 * n + i, 3 * n + i + 1, np.full(sides, 4 * n + 1)], axis=1)
    around = radius * angle
    uv_side = [np.column_stack([around, part[:, 2]]) for part in (low, high)]
    uv = np.concatenate([*uv_side, low[:, :2], high[:, :2], np.zeros((2, 2))]) / tile
    return TexturedMesh(vertices, np.concatenate([side, bottom, top]), uv, texture, material)


def tube(
    start: Float[np.ndarray, "3"],
    end: Float[np.ndarray, "3"],
    radius: float,
    texture: UInt8[np.ndarray, "Th Tw 3"],
    *,
    sides: int = 14,
) -> TexturedMesh:
    """A cylinder from one point to another [m]."""
    along = np.asarray(end, dtype=float) - start
    length = float(np.linalg.norm(along))
    rotation = Rotation.align_vectors([along / length], [[0.0, 0.0, 1.0]])[0]
    T = make_transform(rotation.as_matrix(), (np.asarray(start) + end) / 2.0)
    return moved(cylinder(radius, length, texture, sides=sides), T)


def joined(meshes: Sequence[TexturedMesh]) -> TexturedMesh:
    """Meshes of one texture and material as one mesh, which is drawn faster than many."""
    counts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    faces = [mesh.faces + first for mesh, first in zip(meshes, counts, strict=False)]
    return replace(
        meshes[0],
        vertices=np.concatenate([mesh.vertices for mesh in meshes]),
        faces=np.concatenate(faces),
        uv=np.concatenate([mesh.uv for mesh in meshes]),
    )


def moved(mesh: TexturedMesh, T_dst_src: Float[np.ndarray, "4 4"]) -> TexturedMesh:
    """The mesh in another frame."""
    return replace(mesh, vertices=transform_points(T_dst_src, mesh.vertices))


def placed(mesh: TexturedMesh, *offset: float) -> TexturedMesh:
    """The mesh shifted by x, y, z [m]."""
    return moved(mesh, make_transform(np.eye(3), np.array(offset)))
