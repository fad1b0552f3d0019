"""Points on surfaces."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from robust6dof.shapes.mesh import TexturedMesh


def sample_surface(
    mesh: TexturedMesh, count: int, rng: np.random.Generator
) -> tuple[Float[np.ndarray, "count 3"], Float[np.ndarray, "count 3"]]:
    """Points drawn evenly by area, and the unit normals of their faces."""
    corners = mesh.vertices[mesh.faces]
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    double_area = np.linalg.norm(cross, axis=1)
    face = rng.choice(len(corners), count, p=double_area / double_area.sum())
    a, b = rng.random((2, count, 1))
    root = np.sqrt(a)
    picked = corners[face]
    points = (1 - root) * picked[:, 0] + root * (1 - b) * picked[:, 1] + root * b * picked[:, 2]
    return points, cross[face] / double_area[face, None]


def farthest_points(points: Float[np.ndarray, "N 3"], count: int) -> Int[np.ndarray, "count"]:
    """Indices of points spread evenly: each next one is the farthest from all before.

    Starts at the point farthest from the mean, so the result needs no seed.
    """
    chosen = np.empty(count, dtype=np.int64)
    chosen[0] = np.argmax(((points - points.mean(axis=0)) ** 2).sum(axis=1))
    distance = np.full(len(points), np.inf)
    for i in range(1, count):
        step = points - points[chosen[i - 1]]
        distance = np.minimum(distance, np.einsum("nd,nd->n", step, step))
        chosen[i] = np.argmax(distance)
    return chosen
