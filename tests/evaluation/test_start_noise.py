"""The starting noise has the distribution that the evaluations it comes from use."""

from dataclasses import dataclass

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from evaluation.pose_records import EXTENTS, TRUE_POSE
from robust6dof.evaluation.start_noise import (
    PertNoise,
    displaced,
    exact,
    perturb,
    shift_uniformly,
)
from robust6dof.frames import Track, TrackState
from robust6dof.geometry.transforms import make_transform, rotation_error


def draw(function, n=1000, **options):
    rng = np.random.default_rng(0)
    return [function(TRUE_POSE, EXTENTS, rng, **options) for _ in range(n)]


@pytest.mark.parametrize("multiple", [1.0, 2.0])
def test_pert_noise_has_captras_spread(multiple):
    starts = draw(perturb, noise=PertNoise(multiple=multiple))
    T = np.array([T_cam_obj for T_cam_obj, _ in starts])
    angles = np.degrees(rotation_error(T[:, :3, :3], TRUE_POSE[None, :3, :3]))
    shifts = np.linalg.norm(T[:, :3, 3] - TRUE_POSE[:3, 3], axis=1)
    # The root mean square of |N(0, σ)| is σ.
    assert np.sqrt(np.mean(angles**2)) == pytest.approx(5.0 * multiple, rel=0.1)
    assert np.sqrt(np.mean(shifts**2)) == pytest.approx(0.03 * multiple, rel=0.1)
    assert np.abs((T[:, :3, 3] - TRUE_POSE[:3, 3]).mean(axis=0)).max() < 0.006 * multiple


def test_pert_noise_scales_the_box_as_a_whole():
    extents = np.array([size for _, size in draw(perturb)])
    ratios = extents / EXTENTS
    np.testing.assert_allclose(ratios, ratios[:, :1] * np.ones(3))
    diagonals = np.linalg.norm(extents, axis=1)
    assert np.std(diagonals) == pytest.approx(0.02, rel=0.1)
    assert diagonals.min() > 0


def test_no_multiple_is_no_noise():
    T, extents = perturb(TRUE_POSE, EXTENTS, np.random.default_rng(0), PertNoise(multiple=0.0))
    np.testing.assert_allclose(T, TRUE_POSE)
    np.testing.assert_allclose(extents, EXTENTS)


def test_six_pack_start_is_a_cube_of_two_centimetres_without_rotation():
    T = np.array([T_cam_obj for T_cam_obj, _ in draw(shift_uniformly)])
    shifts = T[:, :3, 3] - TRUE_POSE[:3, 3]
    assert np.abs(shifts).max() <= 0.02
    assert np.abs(shifts).max(axis=0).min() > 0.0195
    np.testing.assert_array_equal(T[:, :3, :3], np.tile(TRUE_POSE[:3, :3], (1000, 1, 1)))


def test_starts_repeat_with_their_seed_and_exact_is_exact():
    first, second = draw(perturb, n=3), draw(perturb, n=3)
    np.testing.assert_array_equal(first[2][0], second[2][0])
    T, _ = exact(TRUE_POSE, EXTENTS, np.random.default_rng(0))
    np.testing.assert_array_equal(T, TRUE_POSE)


def test_noise_on_every_pose_reaches_a_tracker_inside_the_tracker():
    @dataclass(frozen=True)
    class Memory:
        surface: Track
        frames: int

    inner_pose = make_transform(np.eye(3), np.array([0.0, 0.1, 1.0]))
    inner = Track(inner_pose, np.ones(3), 1.0, TrackState.TRACKING, "mug")
    outer = Track(np.eye(4), np.ones(3), 1.0, TrackState.TRACKING, "mug", memory=Memory(inner, 3))
    R = Rotation.from_rotvec([0.1, -0.2, 0.05]).as_matrix()
    T_noisy = make_transform(R, np.array([0.01, 0.02, 0.03]))
    moved = displaced(outer, T_noisy)
    np.testing.assert_allclose(moved.T_cam_obj, T_noisy)
    np.testing.assert_allclose(moved.memory.surface.T_cam_obj, T_noisy @ inner_pose)
    assert moved.memory.frames == 3
    np.testing.assert_array_equal(outer.memory.surface.T_cam_obj, inner_pose)
