"""Interaction matrices against finite differences, pinocchio, ViSP and numbers by hand."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from robust6dof.geometry.transforms import axis_error, rotation_about_y, rotation_error
from robust6dof.servo.interaction import (
    extended_image_point,
    nearest_symmetric_turn,
    point_interaction,
    printed_rotation_error_vector,
    printed_rotation_vector_interaction,
    rotation_error_vector,
    rotation_vector_interaction,
)

STEP = 1e-6
VISP = json.loads(Path(__file__).with_name("visp_numbers.json").read_text())
"""What ViSP 3.5.0 computes; `visp_numbers.cpp` printed it."""


def _random_rotation(rng: np.random.Generator) -> np.ndarray:
    return Rotation.random(rng=rng).as_matrix()


def _turned(R_cam_obj: np.ndarray, omega: np.ndarray, dt: float) -> np.ndarray:
    """R_cam_obj after the camera turned with `omega` (own axes): R_cam_new_obj."""
    return Rotation.from_rotvec(-omega * dt).as_matrix() @ R_cam_obj


def test_point_interaction_matches_finite_differences():
    rng = np.random.default_rng(0)
    for _ in range(50):
        t = rng.uniform([-1, -1, 0.3], [1, 1, 3])
        v, omega = rng.normal(size=3), rng.normal(size=3)
        t_dot = -v - np.cross(omega, t)
        ahead, behind = (extended_image_point(t + s * t_dot) for s in (STEP, -STEP))
        expected = (ahead - behind) / (2 * STEP)
        L = point_interaction(t)
        np.testing.assert_allclose(L @ np.concatenate([v, omega]), expected, atol=1e-7)


def test_point_interaction_golden_numbers():
    """x = 0.1, y = 0.2, Z = 2 by hand: the rows of an image point (x, y) and of log Z."""
    expected = [
        [-0.5, 0.0, 0.05, 0.02, -1.01, 0.2],
        [0.0, -0.5, 0.1, 1.04, -0.02, -0.1],
        [0.0, 0.0, -0.5, -0.2, 0.1, 0.0],
    ]
    np.testing.assert_allclose(point_interaction(np.array([0.2, 0.4, 2.0])), expected, atol=1e-15)


def test_rotation_vector_interaction_golden_numbers():
    """A right angle about x: sinc(π/2) / sinc²(π/4) = π/4, so the lower block is all π/4."""
    quarter = np.pi / 4
    expected = [[1, 0, 0], [0, quarter, -quarter], [0, quarter, quarter]]
    theta_u = np.array([np.pi / 2, 0, 0])
    np.testing.assert_allclose(rotation_vector_interaction(theta_u), expected, atol=1e-15)


def test_rotation_vector_interaction_matches_pinocchio():
    pin = pytest.importorskip("pinocchio")
    rng = np.random.default_rng(1)
    for angle in (1e-12, 1e-6, 0.3, 1.5, 3.0):
        axis = rng.normal(size=3)
        theta_u = angle * axis / np.linalg.norm(axis)
        expected = pin.Jlog3(pin.exp3(theta_u))
        np.testing.assert_allclose(rotation_vector_interaction(theta_u), expected, atol=1e-9)


@pytest.mark.parametrize("case", VISP["points"])
def test_point_interaction_is_visps(case):
    """Its features x, y (vpFeaturePoint) and log(Z/Z*) (vpFeatureDepth)."""
    expected = np.vstack([case["xy"], case["log_Z"]])
    L = point_interaction(np.array(case["t_cam_obj"]))
    np.testing.assert_allclose(L, expected, atol=1e-15)


@pytest.mark.parametrize("case", VISP["turns"])
def test_rotation_vector_interaction_is_visps(case):
    """Its θu of c*R_c; the paper's print is that of cR_c* without its minus (vpFeatureThetaU)."""
    theta_u = np.array(case["theta_u"])
    L, printed = rotation_vector_interaction(theta_u), printed_rotation_vector_interaction(theta_u)
    np.testing.assert_allclose(L, case["goal_R_cam"], atol=1e-12)
    np.testing.assert_allclose(printed, -np.array(case["cam_R_goal"]), atol=1e-12)


def test_rotation_error_moves_as_its_matrix_says():
    rng = np.random.default_rng(2)
    for _ in range(50):
        R_goal, omega = _random_rotation(rng), rng.normal(size=3)
        R = Rotation.from_rotvec(rng.normal(size=3)).as_matrix() @ R_goal
        theta_u = rotation_error_vector(R, R_goal)
        ahead, behind = (
            rotation_error_vector(_turned(R, omega, dt), R_goal) for dt in (STEP, -STEP)
        )
        expected = (ahead - behind) / (2 * STEP)
        np.testing.assert_allclose(
            rotation_vector_interaction(theta_u) @ omega, expected, atol=1e-7
        )


def test_printed_matrix_is_minus_that_of_the_opposite_rotation():
    """For φ of cR_c*: φ̇ = −(I − θ/2 [u]× + …) ω; the paper prints it without the minus."""
    rng = np.random.default_rng(3)
    for _ in range(20):
        R_goal, omega = _random_rotation(rng), rng.normal(size=3)
        R = Rotation.from_rotvec(rng.normal(size=3)).as_matrix() @ R_goal

        def error(dt: float, R=R, R_goal=R_goal, omega=omega) -> np.ndarray:
            return Rotation.from_matrix(_turned(R, omega, dt) @ R_goal.T).as_rotvec()

        expected = (error(STEP) - error(-STEP)) / (2 * STEP)
        L = printed_rotation_vector_interaction(error(0.0))
        np.testing.assert_allclose(-L @ omega, expected, atol=1e-7)


@given(st.lists(st.floats(-1.7, 1.7), min_size=3, max_size=3))
def test_the_matrix_leaves_its_own_vector_alone(theta_u):
    """L θu = θu, so that ω = −λ L⁻¹ θu is simply −λ θu."""
    vector = np.array(theta_u)
    np.testing.assert_allclose(rotation_vector_interaction(vector) @ vector, vector, atol=1e-12)


def test_printed_error_is_the_same_vector_seen_from_the_desired_object_frame():
    rng = np.random.default_rng(4)
    for _ in range(20):
        R, R_goal = _random_rotation(rng), _random_rotation(rng)
        np.testing.assert_allclose(
            R_goal @ printed_rotation_error_vector(R, R_goal),
            rotation_error_vector(R, R_goal),
            atol=1e-7,
        )


def test_symmetric_turn_is_the_best_of_all_and_leaves_the_angle_of_the_axis():
    rng = np.random.default_rng(5)
    for _ in range(10):
        R, R_goal = _random_rotation(rng), _random_rotation(rng)
        turns = np.stack([rotation_about_y(angle) for angle in np.linspace(-np.pi, np.pi, 721)])
        best_of_many = rotation_error(R @ turns, R_goal).min()
        best = rotation_error(R @ nearest_symmetric_turn(R, R_goal), R_goal)
        assert best <= best_of_many + 1e-9
        assert best == pytest.approx(float(axis_error(R, R_goal)), abs=1e-7)
        theta_u = rotation_error_vector(R, R_goal, symmetric=True)
        assert np.linalg.norm(theta_u) == pytest.approx(float(best), abs=1e-7)


@given(st.floats(-np.pi, np.pi))
def test_symmetric_error_ignores_the_yaw(angle):
    R_goal = Rotation.from_rotvec([1.2, -0.4, 0.8]).as_matrix()
    R = Rotation.from_rotvec([0.9, 0.1, 0.5]).as_matrix()
    np.testing.assert_allclose(
        rotation_error_vector(R @ rotation_about_y(angle), R_goal, symmetric=True),
        rotation_error_vector(R, R_goal, symmetric=True),
        atol=1e-7,
    )
