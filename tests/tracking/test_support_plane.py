"""Planes are found among clutter, turned to the viewer, and carried between frames."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from robust6dof.geometry.transforms import invert_transform, make_transform, transform_points
from robust6dof.tracking.motion import Motion, seconds_between
from robust6dof.tracking.support_plane import Plane, fit_plane


@given(seed=st.integers(0, 1000))
def test_finds_the_plane_among_outliers(seed: int) -> None:
    rng = np.random.default_rng(seed)
    T = make_transform(Rotation.random(rng=rng).as_matrix(), np.array([0.0, 0.0, 1.5]))
    flat = np.column_stack([rng.uniform(-0.5, 0.5, (400, 2)), 0.001 * rng.normal(size=400)])
    outliers = rng.uniform(-0.5, 0.5, (150, 3))
    found = fit_plane(transform_points(T, np.concatenate([flat, outliers])), rng, tolerance=0.004)
    assert found is not None
    plane, inliers = found
    assert inliers[:400].mean() > 0.95
    assert abs(plane.normal @ T[:3, 2]) > np.cos(np.deg2rad(1.0))
    assert plane.height(np.zeros(3)) >= 0


def test_no_plane_in_two_points_or_a_line() -> None:
    rng = np.random.default_rng(0)
    assert fit_plane(np.zeros((2, 3)), rng, tolerance=0.01) is None
    assert fit_plane(np.zeros((50, 3)), rng, tolerance=0.01) is None


def test_height_does_not_depend_on_the_frame() -> None:
    rng = np.random.default_rng(0)
    plane = Plane(np.array([0.0, 0.6, 0.8]), -0.3)
    T = make_transform(Rotation.random(rng=rng).as_matrix(), rng.normal(size=3))
    points = rng.normal(size=(20, 3))
    moved = plane.transformed(T)
    np.testing.assert_allclose(moved.height(transform_points(T, points)), plane.height(points))
    back = moved.transformed(invert_transform(T))
    np.testing.assert_allclose(back.normal, plane.normal, atol=1e-12)
    assert back.offset == pytest.approx(plane.offset)


def test_constant_velocity_predicts_a_constant_motion() -> None:
    turn = Rotation.from_rotvec([0.02, -0.03, 0.05]).as_matrix()
    T_old = make_transform(Rotation.from_rotvec([1.0, 0.3, 0.2]).as_matrix(), np.array([0, 0, 1.0]))
    T_new = make_transform(turn @ T_old[:3, :3], T_old[:3, 3] + [0.01, 0.0, -0.02])
    predicted = Motion.between(T_old, T_new, 0.05).predict(T_new, 0.1)
    np.testing.assert_allclose(predicted[:3, :3], turn @ turn @ T_new[:3, :3], atol=1e-12)
    np.testing.assert_allclose(predicted[:3, 3], T_new[:3, 3] + [0.02, 0.0, -0.04], atol=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [(1.0, 1.05, 0.05), (None, 1.0, 1 / 30), (1.0, 0.5, 1 / 30), (1.0, 3.5, 2.5)],
)
def test_time_between_stamps(old: float | None, new: float | None, expected: float) -> None:
    assert seconds_between(old, new) == pytest.approx(expected)
