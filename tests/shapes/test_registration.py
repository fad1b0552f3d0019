"""Non-rigid registration recovers known deformations and keeps the sides of thin walls apart."""

from __future__ import annotations

import numpy as np
import trimesh

from robust6dof.shapes.registration import Drift, register


def sphere() -> tuple[np.ndarray, np.ndarray]:
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.5)
    return np.array(ball.vertices), np.array(ball.vertices) * 2


def test_sphere_becomes_the_ellipsoid() -> None:
    points, normals = sphere()
    stretch = np.array([0.7, 1.2, 1.0])
    other = normals / stretch
    other /= np.linalg.norm(other, axis=1, keepdims=True)
    moved = register(points, normals, points * stretch, other).apply(points)
    nearest = np.linalg.norm(moved[:, None] - points * stretch, axis=2).min(axis=1)
    before = np.linalg.norm(points[:, None] - points * stretch, axis=2).min(axis=1)
    assert nearest.mean() < 0.02 < before.mean()
    np.testing.assert_allclose(np.ptp(moved, axis=0), stretch, atol=0.03)


def test_a_shape_registered_to_itself_stays() -> None:
    points, normals = sphere()
    moved = register(points, normals, points, normals).apply(points)
    assert np.linalg.norm(moved - points, axis=1).mean() < 0.01


def test_sides_of_a_thin_plate_do_not_swap() -> None:
    grid = np.stack(np.meshgrid(np.linspace(-0.4, 0.4, 15), np.linspace(-0.4, 0.4, 15)), -1)
    flat = np.column_stack([grid.reshape(-1, 2), np.zeros(225)])
    up = np.tile([0.0, 0.0, 1.0], (225, 1))
    plate = np.concatenate([flat + 0.01 * up, flat - 0.01 * up])
    normals = np.concatenate([up, -up])
    raised = plate + [0.0, 0.0, 0.05]
    moved = register(plate, normals, raised, normals).apply(plate)
    assert (moved[:225, 2] > moved[225:, 2]).all()


def test_normals_turn_with_the_surface() -> None:
    centres = np.array([[0.3, 0.0, 0.0]])
    drift = Drift(centres, np.array([[0.0, 0.2, 0.0]]), 0.3)
    points = np.array([[0.0, 0.0, 0.0], [0.2, 0.0, 0.1]])
    normals = np.tile([0.0, 1.0, 0.0], (2, 1))
    # The motion lifts y by h(x, z); the surface y = h has the normal (−∂h/∂x, 1, −∂h/∂z).
    offset = points - centres[0]
    height = 0.2 * np.exp(-(offset**2).sum(axis=1) / (2 * 0.3**2))
    slope = -offset * height[:, None] / 0.3**2
    expected = np.column_stack([-slope[:, 0], np.ones(2), -slope[:, 2]])
    expected /= np.linalg.norm(expected, axis=1, keepdims=True)
    np.testing.assert_allclose(drift.turn(points, normals), expected, atol=1e-3)
