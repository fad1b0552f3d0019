"""The registration finds known motions, and leaves to the prior what it cannot see."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from robust6dof.geometry.transforms import invert_transform, make_transform, transform_points
from robust6dof.tracking.surface.cloud import Cloud
from robust6dof.tracking.surface.registration import (
    Evidence,
    Registration,
    Stage,
    independent,
    register,
)
from robust6dof.tracking.surface.registration_target import RegistrationTarget, intensity_gradients

LOOSE = independent(1.0, 1.0)
STAGES = [Stage(0.05, 20, color=False), Stage(0.02, 30)]


def fit_of(source: Cloud, target: RegistrationTarget, prior: np.ndarray) -> Registration | None:
    return register([Evidence(source, target, 0.001)], STAGES, prior)


def ellipsoid(count: int, seed: int, printed: bool = False) -> Cloud:
    """Half-axes 3, 5, 4 cm, evenly enough sampled; a print that varies around y."""
    rng = np.random.default_rng(seed)
    axes = np.array([0.03, 0.05, 0.04])
    return _closed_surface(rng.normal(size=(count, 3)), axes, printed)


def spheroid(count: int, seed: int, printed: bool = False) -> Cloud:
    """Turning about y changes nothing but the print."""
    rng = np.random.default_rng(seed)
    return _closed_surface(rng.normal(size=(count, 3)), np.array([0.04, 0.06, 0.04]), printed)


def _closed_surface(directions: np.ndarray, axes: np.ndarray, printed: bool) -> Cloud:
    unit = directions / np.linalg.norm(directions, axis=-1, keepdims=True)
    points, normals = unit * axes, unit / axes
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    turn = np.arctan2(points[:, 0], points[:, 2])
    print_ = 120.0 + 60.0 * np.sin(3.0 * turn) if printed else np.full(len(points), np.nan)
    return Cloud(points, normals, np.repeat(print_[:, None], 3, axis=1))


def moved(cloud: Cloud, T: np.ndarray) -> Cloud:
    return Cloud(transform_points(T, cloud.points), cloud.normals @ T[:3, :3].T, cloud.color)


def motion(rotvec_deg: list[float], t: list[float]) -> np.ndarray:
    R = Rotation.from_rotvec(rotvec_deg, degrees=True).as_matrix()
    return make_transform(R, np.array(t))


def test_recovers_a_motion_of_a_closed_surface() -> None:
    target = RegistrationTarget.build(ellipsoid(6000, 0))
    T = motion([6.0, -5.0, 4.0], [0.008, -0.006, 0.01])
    source = moved(ellipsoid(500, 1), invert_transform(T))
    fit = fit_of(source, target, LOOSE)
    assert fit is not None
    np.testing.assert_allclose(fit.T_target_source[:3, 3], T[:3, 3], atol=3e-4)
    np.testing.assert_allclose(fit.T_target_source[:3, :3], T[:3, :3], atol=0.012)


def test_clutter_does_not_pull() -> None:
    target = RegistrationTarget.build(ellipsoid(6000, 0))
    T = motion([2.0, 3.0, 1.0], [0.003, 0.002, -0.004])
    clutter = moved(ellipsoid(250, 2), motion([0, 0, 0], [0.09, 0.0, 0.0]))
    source = moved(ellipsoid(500, 1).joined(clutter), invert_transform(T))
    fit = fit_of(source, target, LOOSE)
    assert fit is not None
    np.testing.assert_allclose(fit.T_target_source[:3, 3], T[:3, 3], atol=1e-3)


@pytest.mark.parametrize(("printed", "low", "high"), [(False, -1.0, 2.0), (True, 4.5, 5.5)])
def test_only_print_fixes_the_turn_of_a_symmetric_shape(
    printed: bool, low: float, high: float
) -> None:
    target = RegistrationTarget.build(spheroid(6000, 0, printed))
    source = moved(spheroid(600, 1, printed), motion([0, -5.0, 0], [0, 0, 0]))
    prior = independent(np.deg2rad(4.0), 0.02)
    fit = fit_of(source, target, prior)
    assert fit is not None
    turn = Rotation.from_matrix(fit.T_target_source[:3, :3]).as_rotvec(degrees=True)
    assert low < turn[1] < high
    assert abs(turn[0]) < 0.5
    assert abs(turn[2]) < 0.5


def test_a_turn_that_changes_nothing_in_the_images_counts_as_unseen() -> None:
    prior = independent(np.deg2rad(4.0), 0.02)
    for printed, least, most in ((False, 0.0, 0.2), (True, 0.9, 1.0)):
        target = RegistrationTarget.build(spheroid(6000, 0, printed=printed))
        fit = fit_of(spheroid(600, 1, printed=printed), target, prior)
        assert fit is not None
        seen = fit.seen_rotation
        assert least <= seen[1, 1] <= most
        np.testing.assert_allclose(np.diag(seen)[[0, 2]], 1.0, atol=0.05)


def test_a_change_of_exposure_changes_nothing() -> None:
    target = RegistrationTarget.build(spheroid(6000, 0, printed=True))
    source = moved(spheroid(600, 1, printed=True), motion([0, -5.0, 0], [0, 0, 0]))
    brighter = Cloud(source.points, source.normals, source.color + 40.0)
    prior = independent(np.deg2rad(4.0), 0.02)
    fit = fit_of(brighter, target, prior)
    assert fit is not None
    turn = Rotation.from_matrix(fit.T_target_source[:3, :3]).as_rotvec(degrees=True)
    assert turn[1] == pytest.approx(5.0, abs=0.5)


def test_too_few_partners_is_no_fit() -> None:
    target = RegistrationTarget.build(ellipsoid(500, 0))
    far = moved(ellipsoid(500, 1), motion([0, 0, 0], [1.0, 0.0, 0.0]))
    assert fit_of(far, target, LOOSE) is None


def test_gradient_of_a_linear_print_on_a_plane() -> None:
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(-0.1, 0.1, (2000, 2)), np.zeros(2000)])
    slope = np.array([300.0, -700.0, 0.0])
    cloud = Cloud(
        points,
        np.tile([0.0, 0.0, 1.0], (2000, 1)),
        np.repeat(100.0 + (points @ slope)[:, None], 3, axis=1),
    )
    inner = np.abs(points).max(axis=-1) < 0.08
    gradients = intensity_gradients(cloud)[inner]
    # The 2 % of regularisation shrink it a little.
    np.testing.assert_allclose(np.median(gradients, axis=0), slope, rtol=0.05, atol=1e-6)


@pytest.mark.parametrize(("source", "target"), [(50, 0), (0, 50), (0, 0)])
def test_an_empty_cloud_finds_no_partner(source: int, target: int) -> None:
    clouds = ellipsoid(50, 0)[np.arange(source)], ellipsoid(50, 1)[np.arange(target)]
    assert fit_of(clouds[0], RegistrationTarget.build(clouds[1]), LOOSE) is None
