"""The absolute similarity of one view, and the joint fit of several constraints."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from robust6dof.errors import InputError
from robust6dof.geometry.transforms import (
    axis_error,
    make_transform,
    rotation_about_y,
    rotation_error,
    transform_points,
)
from robust6dof.solver.absolute import fit_absolute
from robust6dof.solver.joint import PairBlock, fit_joint


def scene(seed, count=200, noise=0.001):
    rng = np.random.default_rng(seed)
    T = make_transform(Rotation.random(rng=rng).as_matrix(), np.array([0.05, -0.02, 0.8]))
    canonical = rng.uniform(-0.35, 0.35, (count, 3))
    scale = rng.uniform(0.1, 0.3)
    cam = transform_points(T, scale * canonical) + noise * rng.standard_normal((count, 3))
    return rng, T, canonical, scale, cam


def nudge(T, rng, angle=0.15, shift=0.01):
    axis = rng.standard_normal(3)
    R = Rotation.from_rotvec(angle * axis / np.linalg.norm(axis)).as_matrix()
    return T @ make_transform(R, shift * rng.standard_normal(3))


@settings(deadline=None, max_examples=25)
@given(st.integers(0, 2**31))
def test_absolute_fit_among_background(seed):
    rng, T, canonical, scale, cam = scene(seed)
    background = rng.random(200) < 0.35
    cam[background] += scale * rng.uniform(-1, 1, (background.sum(), 3))
    fit = fit_absolute(canonical, cam, np.ones(200), rng)
    assert np.degrees(rotation_error(fit.T_cam_obj[:3, :3], T[:3, :3])) < 3.0
    assert np.linalg.norm(fit.T_cam_obj[:3, 3] - T[:3, 3]) < 0.03 * scale
    assert fit.scale == pytest.approx(scale, rel=0.06)
    assert fit.inliers[~background].all()


def test_absolute_fit_on_exact_data_is_exact():
    _, T, canonical, scale, cam = scene(1, noise=0.0)
    fit = fit_absolute(canonical, cam, np.ones(200), np.random.default_rng(0))
    np.testing.assert_allclose(fit.T_cam_obj, T, atol=1e-9)
    assert fit.scale == pytest.approx(scale)
    assert fit.inlier_share == 1.0


def test_absolute_fit_names_bad_input():
    with pytest.raises(InputError, match="at least 3"):
        fit_absolute(np.zeros((2, 3)), np.zeros((2, 3)), np.ones(2), np.random.default_rng(0))


@settings(deadline=None, max_examples=25)
@given(st.integers(0, 2**31))
def test_joint_fit_of_exact_blocks_is_exact(seed):
    rng, T, canonical, scale, cam = scene(seed, noise=0.0)
    blocks = [
        PairBlock(scale * canonical[s], cam[s], np.ones(100)) for s in np.split(np.arange(200), 2)
    ]
    fit = fit_joint(blocks, nudge(T, rng), robust_distance=0.05, iterations=30)
    np.testing.assert_allclose(fit.T_cam_obj, T, atol=1e-6)
    assert (fit.support > 0.999).all()
    assert np.linalg.eigvalsh(fit.information).min() > 0


def test_an_anchor_with_free_yaw_corrects_tilt_but_not_yaw():
    rng, T, canonical, scale, cam = scene(4, noise=0.0)
    turned = scale * canonical @ rotation_about_y(0.9).T  # the anchor's own idea of yaw
    anchor = PairBlock(turned, cam, 5.0 * np.ones(200), free_yaw=True)
    chained = nudge(T, rng)
    own = PairBlock(
        canonical[:20] * scale, transform_points(chained, canonical[:20] * scale), np.ones(20)
    )
    alone = fit_joint([anchor], chained, 0.5, iterations=40)
    assert np.degrees(axis_error(alone.T_cam_obj[:3, :3], T[:3, :3])) < 1e-3
    both = fit_joint([own, anchor], chained, 0.5, iterations=40)
    assert np.degrees(axis_error(both.T_cam_obj[:3, :3], T[:3, :3])) < 3.0
    # A rigid anchor would have pulled the pose by most of its 0.9 rad.
    assert rotation_error(both.T_cam_obj[:3, :3], T[:3, :3]) < 0.2
    assert alone.information[1, 1] == pytest.approx(0.0, abs=1e-9)


def test_free_yaw_of_a_right_anchor_leaves_the_others_yaw_untouched():
    rng, T, canonical, scale, cam = scene(6, noise=0.0)
    twisted = T @ make_transform(rotation_about_y(0.2), np.zeros(3))
    last = PairBlock(scale * canonical, transform_points(twisted, scale * canonical), np.ones(200))
    anchor = PairBlock(scale * canonical, cam, 10.0 * np.ones(200), free_yaw=True)
    fit = fit_joint([last, anchor], nudge(T, rng, 0.05), 0.5, iterations=40)
    np.testing.assert_allclose(fit.T_cam_obj, twisted, atol=1e-6)


def test_outlying_pairs_and_blocks_lose_their_say():
    rng, T, canonical, scale, cam = scene(7)
    points = scale * canonical
    good = PairBlock(points, cam, np.ones(200))
    stale = PairBlock(points[:60], cam[:60] + [0.05, 0.0, 0.0], np.ones(60))
    fit = fit_joint([good, stale], nudge(T, rng, 0.02, 0.001), 0.01, iterations=30)
    assert np.linalg.norm(fit.T_cam_obj[:3, 3] - T[:3, 3]) < 0.001
    assert fit.support[0] > 0.9
    assert fit.support[1] < 0.1


def test_empty_blocks_are_allowed_but_not_only_empty_ones():
    _, T, canonical, scale, cam = scene(8, noise=0.0)
    empty = PairBlock(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0))
    fit = fit_joint([empty, PairBlock(scale * canonical, cam, np.ones(200))], T, 0.01)
    np.testing.assert_allclose(fit.T_cam_obj, T, atol=1e-9)
    with pytest.raises(InputError, match="at least one pair"):
        fit_joint([empty], T, 0.01)
