"""RANSAC on 3D-3D pairs and PnP: right among outliers, seeded, clear about bad input."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from robust6dof.errors import InputError
from robust6dof.geometry.camera import project
from robust6dof.geometry.transforms import make_transform, rotation_error, transform_points
from robust6dof.solver.pnp import ransac_pnp
from robust6dof.solver.rigid_ransac import ransac_rigid, triangle_frames

K = np.array([[600.0, 0.0, 320.0], [0.0, 600.0, 240.0], [0.0, 0.0, 1.0]])


def scene(seed, count=128, outliers=0.4, noise=0.001):
    rng = np.random.default_rng(seed)
    src = rng.standard_normal((count, 3)) * 0.06 + [0.0, 0.0, 0.7]
    R = Rotation.from_rotvec(0.3 * rng.standard_normal(3)).as_matrix()
    centre = np.array([0.0, 0.0, 0.7])
    T = make_transform(R, centre - R @ centre + 0.02 * rng.standard_normal(3))
    dst = transform_points(T, src) + noise * rng.standard_normal(src.shape)
    wrong = rng.random(count) < outliers
    dst[wrong] += 0.1 * rng.standard_normal((wrong.sum(), 3)) + 0.05
    return src, dst, T, wrong


@settings(deadline=None, max_examples=25)
@given(st.integers(0, 2**31))
def test_rigid_fit_among_outliers(seed):
    src, dst, T, wrong = scene(seed)
    fit = ransac_rigid(src, dst, None, 0.008, np.random.default_rng(seed))
    assert np.degrees(rotation_error(fit.T_dst_src[:3, :3], T[:3, :3])) < 0.8
    moved = transform_points(fit.T_dst_src, src) - transform_points(T, src)
    assert np.abs(moved).max() < 0.004
    assert fit.inliers[~wrong].all()
    assert fit.residual < 0.004


def test_weights_decide_between_two_motions():
    src, dst, T, _ = scene(1, outliers=0.0)
    other = make_transform(
        Rotation.from_rotvec([0.0, 0.0, 0.5]).as_matrix(), np.array([0.1, 0.0, 0.0])
    )
    dst[:80] = transform_points(other, src[:80])  # the larger half, trusted less
    weight = np.where(np.arange(128) < 80, 0.1, 1.0)
    fit = ransac_rigid(src, dst, weight, 0.008, np.random.default_rng(0))
    assert np.degrees(rotation_error(fit.T_dst_src[:3, :3], T[:3, :3])) < 0.8
    assert fit.inlier_share == pytest.approx(48 / 128, abs=0.05)


def test_the_same_seed_gives_the_same_fit():
    src, dst, _, _ = scene(3)
    a, b = (ransac_rigid(src, dst, None, 0.01, np.random.default_rng(4)) for _ in range(2))
    assert np.array_equal(a.T_dst_src, b.T_dst_src)


@pytest.mark.parametrize("kind", ["one place", "line"])
def test_degenerate_pairs_give_a_finite_rotation(kind):
    src = np.zeros((6, 3)) if kind == "one place" else np.outer(np.arange(6.0), [0.01, 0.02, 0.0])
    fit = ransac_rigid(src, src + 0.1, None, 0.01, np.random.default_rng(0))
    R = fit.T_dst_src[:3, :3]
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-9)
    np.testing.assert_allclose(transform_points(fit.T_dst_src, src), src + 0.1, atol=1e-9)


def test_pairs_that_share_nothing_have_few_inliers():
    rng = np.random.default_rng(0)
    fit = ransac_rigid(rng.standard_normal((60, 3)), rng.standard_normal((60, 3)), None, 0.01, rng)
    assert fit.inlier_share < 0.15


def test_bad_input_is_named():
    with pytest.raises(InputError, match="at least 3 pairs"):
        ransac_rigid(np.zeros((2, 3)), np.zeros((2, 3)), None, 0.01, np.random.default_rng(0))
    with pytest.raises(InputError, match="finite"):
        ransac_rigid(
            np.full((4, 3), np.nan), np.zeros((4, 3)), None, 0.01, np.random.default_rng(0)
        )
    with pytest.raises(InputError, match="at least 4 pairs"):
        ransac_pnp(np.zeros((3, 3)), np.zeros((3, 2)), K)


def test_triangle_frames_are_rotations_that_turn_with_the_triangle():
    rng = np.random.default_rng(0)
    triangles = rng.standard_normal((20, 3, 3))
    R = Rotation.random(rng=rng).as_matrix()
    frames = triangle_frames(triangles)
    np.testing.assert_allclose(np.linalg.det(frames), 1.0)
    np.testing.assert_allclose(triangle_frames(triangles @ R.T + 1.0), R @ frames, atol=1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_pnp_finds_the_motion_from_pixels(seed):
    src, dst, T, wrong = scene(seed, noise=0.0)
    fit = ransac_pnp(src, project(dst, K), K, seed=seed)
    assert fit is not None
    assert np.degrees(rotation_error(fit.T_dst_src[:3, :3], T[:3, :3])) < 0.1
    assert np.linalg.norm(fit.T_dst_src[:3, 3] - T[:3, 3]) < 0.002
    assert fit.inliers[~wrong].all()


def test_pnp_leaves_depth_unused_and_pays_for_it():
    """The reason why the rigid fit is the default: pixel noise of 1 px, depth noise of 1 mm."""
    errors = {"rigid": [], "pnp": []}
    for seed in range(20):
        src, dst, T, _ = scene(seed, outliers=0.2, noise=0.001)
        rigid = ransac_rigid(src, dst, None, 0.008, np.random.default_rng(seed))
        pnp = ransac_pnp(src, project(dst, K), K, seed=seed)
        assert pnp is not None
        middle = src.mean(0)
        for name, fit in (("rigid", rigid), ("pnp", pnp)):
            gap = transform_points(fit.T_dst_src, middle) - transform_points(T, middle)
            errors[name].append(np.linalg.norm(gap))
    assert np.median(errors["rigid"]) < np.median(errors["pnp"])
