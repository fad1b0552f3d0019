"""Points on surfaces: on the surface, even by area, far from each other."""

from __future__ import annotations

import numpy as np

from robust6dof.shapes.mesh import TexturedMesh
from robust6dof.shapes.sampling import farthest_points, sample_surface

TEXTURE = np.zeros((1, 1, 3), np.uint8)


def two_triangles() -> TexturedMesh:
    """One in z = 0 with area 1/2, one in x = 5 with area 3/2."""
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [5, 0, 0], [5, 3, 0], [5, 0, 1]], float)
    return TexturedMesh(vertices, np.array([[0, 1, 2], [3, 4, 5]]), np.zeros((6, 2)), TEXTURE)


def test_points_lie_on_their_triangles_in_proportion_to_area() -> None:
    points, normals = sample_surface(two_triangles(), 8000, np.random.default_rng(0))
    first = points[:, 0] < 2
    assert abs(first.mean() - 0.25) < 0.02
    np.testing.assert_array_equal(points[first, 2], 0)
    assert (points[first, :2].sum(axis=1) <= 1 + 1e-12).all()
    np.testing.assert_allclose(normals[first], np.tile([0.0, 0, 1], (first.sum(), 1)))
    np.testing.assert_allclose(normals[~first], np.tile([1.0, 0, 0], ((~first).sum(), 1)))
    np.testing.assert_allclose(points[first].mean(axis=0), [1 / 3, 1 / 3, 0], atol=0.02)


def test_farthest_points_match_the_definition() -> None:
    points = np.random.default_rng(1).normal(size=(60, 3))
    chosen = farthest_points(points, 12)
    assert len(set(chosen)) == 12
    for i in range(1, 12):
        to_before = np.linalg.norm(points[:, None] - points[chosen[:i]], axis=2).min(axis=1)
        assert to_before[chosen[i]] == to_before.max()
