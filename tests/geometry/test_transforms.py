"""Axioms of rigid transforms, and rotation angles that stay exact where arccos does not."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from robust6dof.errors import InputError
from robust6dof.geometry.transforms import (
    axis_error,
    check_transform,
    invert_transform,
    make_transform,
    rotation_about_y,
    rotation_angle,
    rotation_error,
    skew,
    transform_points,
)

seeds = st.integers(0, 2**31)


def random_transform(seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return make_transform(Rotation.random(rng=rng).as_matrix(), rng.normal(size=3))


@given(seeds)
def test_inverse_and_composition(seed: int) -> None:
    T_a_b, T_b_c = random_transform(seed), random_transform(seed + 1)
    points_c = np.random.default_rng(seed).normal(size=(5, 3))
    np.testing.assert_allclose(T_a_b @ invert_transform(T_a_b), np.eye(4), atol=1e-12)
    np.testing.assert_allclose(
        transform_points(T_a_b @ T_b_c, points_c),
        transform_points(T_a_b, transform_points(T_b_c, points_c)),
        atol=1e-12,
    )


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-5, 0.1, 1.0, 3.0, np.pi - 1e-6, np.pi])
def test_rotation_angle_is_exact_from_nothing_to_a_half_turn(angle: float) -> None:
    axis = np.array([1.0, -2.0, 0.5]) / np.linalg.norm([1.0, -2.0, 0.5])
    R = Rotation.from_rotvec(angle * axis).as_matrix()
    assert rotation_angle(R) == pytest.approx(angle, rel=1e-7, abs=1e-12)


@given(seeds, st.floats(-3.0, 3.0))
def test_a_turn_about_y_is_no_axis_error(seed: int, turn: float) -> None:
    R = random_transform(seed)[:3, :3]
    assert axis_error(R @ rotation_about_y(turn), R) == pytest.approx(0.0, abs=1e-7)
    assert rotation_error(R @ rotation_about_y(turn), R) == pytest.approx(abs(turn), abs=1e-7)


@given(seeds)
def test_skew_is_the_cross_product(seed: int) -> None:
    v, w = np.random.default_rng(seed).normal(size=(2, 3))
    np.testing.assert_allclose(skew(v) @ w, np.cross(v, w), atol=1e-12)


def test_unusable_transforms_are_refused() -> None:
    for broken, message in [
        (np.eye(3), "4×4"),
        (np.full((4, 4), np.nan), "NaN"),
        (np.diag([2.0, 2.0, 2.0, 1.0]), "not a rotation"),
        (np.diag([-1.0, 1.0, 1.0, 1.0]), "not a rotation"),
        (np.diag([1.0, 1.0, 1.0, 2.0]), "last row"),
    ]:
        with pytest.raises(InputError, match=message):
            check_transform(broken, "start")
