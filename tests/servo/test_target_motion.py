"""The target's motion filter: the kinematics it assumes, and how well it is calibrated."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from robust6dof.geometry.transforms import (
    invert_transform,
    make_transform,
    rotation_about_y,
    rotation_error,
)
from robust6dof.servo.target_motion import (
    TargetMotionNoise,
    carry_motion,
    correct_motion,
    predict_motion,
    start_motion,
)

NOISE = TargetMotionNoise()
DT = 0.05


def _advance(T: np.ndarray, twist: np.ndarray, dt: float) -> np.ndarray:
    """A frame that moves with a twist in its own axes."""
    half = Rotation.from_rotvec(twist[3:] * dt / 2).as_matrix()
    return T @ make_transform(half @ half, half @ twist[:3] * dt)


def _true_motion(seconds: float, rng: np.random.Generator, noise: float = 0.0):
    """A camera that swings about and a target that moves and turns steadily, as seen."""
    T_world_cam = make_transform(Rotation.from_rotvec([3.0, 0.2, 0.1]).as_matrix(), np.zeros(3))
    T_world_obj = make_transform(
        Rotation.from_rotvec([1.5, 0, 0]).as_matrix(), np.array([0, 0, -1.0])
    )
    v_world, w_world = np.array([0.25, -0.1, 0.0]), np.array([0.0, 0.0, 0.3])
    for i in range(round(seconds / DT)):
        camera_twist = 0.2 * np.sin(np.array([1.1, 0.7, 1.3, 0.9, 1.7, 0.8]) * i * DT)
        for _ in range(4):
            T_world_cam = _advance(T_world_cam, camera_twist, DT / 4)
        R = Rotation.from_rotvec(w_world * DT).as_matrix()
        T_world_obj = make_transform(R @ T_world_obj[:3, :3], T_world_obj[:3, 3] + v_world * DT)
        T_cam_obj = invert_transform(T_world_cam) @ T_world_obj
        R_cam_world = T_world_cam[:3, :3].T
        twist = np.concatenate([R_cam_world @ v_world, R_cam_world @ w_world])
        jitter = Rotation.from_rotvec(rng.normal(0, noise * 6, 3)).as_matrix()
        seen = make_transform(
            jitter @ T_cam_obj[:3, :3], T_cam_obj[:3, 3] + rng.normal(0, noise, 3)
        )
        yield camera_twist, seen, twist


def test_filter_finds_the_target_s_twist_from_a_swinging_camera():
    motion, twist = None, np.zeros(6)
    for step in _true_motion(8.0, np.random.default_rng(0)):
        camera_twist, seen, twist = step
        if motion is None:
            motion = start_motion(seen, NOISE)
        else:
            motion = correct_motion(predict_motion(motion, camera_twist, DT, NOISE), seen, NOISE)
    assert motion is not None
    np.testing.assert_allclose(motion.twist, twist, atol=0.01)


def test_stated_deviation_is_the_observed_one():
    """Measurement noise as assumed and a target that manoeuvres less: errors stay in their σ."""
    rng = np.random.default_rng(1)
    motion, squares = None, []
    for i, (camera_twist, seen, twist) in enumerate(_true_motion(30.0, rng, NOISE.position)):
        if motion is None:
            motion = start_motion(seen, NOISE)
            continue
        motion = correct_motion(predict_motion(motion, camera_twist, DT, NOISE), seen, NOISE)
        if i > 100:
            squares.append((motion.twist[:3] - twist[:3]) ** 2)
    sigma = np.sqrt(motion.linear_covariance[1, 1])
    observed = np.sqrt(np.mean(squares))
    assert 0.02 < sigma < 0.1
    assert 0.2 * sigma < observed < sigma


def test_a_standing_target_seen_with_noise_hardly_seems_to_move():
    rng = np.random.default_rng(2)
    T = make_transform(np.eye(3), np.array([0.0, 0.0, 0.6]))
    motion, speeds = start_motion(T, NOISE), []
    for _ in range(400):
        seen = T.copy()
        seen[:3, 3] += rng.normal(0, NOISE.position, 3)
        motion = correct_motion(predict_motion(motion, np.zeros(6), DT, NOISE), seen, NOISE)
        speeds.append(motion.twist[:3])
    assert np.std(speeds[100:]) < 0.03  # m/s per axis, from 5 mm at 20 Hz


def test_carry_motion_matches_fine_integration():
    rng = np.random.default_rng(3)
    T = make_transform(Rotation.from_rotvec([0.3, -0.2, 0.1]).as_matrix(), np.array([0.1, 0, 0.8]))
    start = start_motion(T, NOISE)
    start.twist[:] = rng.normal(0, 0.3, 6)
    camera_twist = rng.normal(0, 0.3, 6)
    once = carry_motion(start, camera_twist, 0.05, 1.0)
    fine = start
    for _ in range(200):
        fine = carry_motion(fine, camera_twist, 0.05 / 200, 1.0)
    np.testing.assert_allclose(once.T_cam_obj[:3, 3], fine.T_cam_obj[:3, 3], atol=1e-5)
    assert rotation_error(once.T_cam_obj[:3, :3], fine.T_cam_obj[:3, :3]) < 5e-4
    np.testing.assert_allclose(once.twist, fine.twist, atol=1e-9)


def test_symmetric_measurements_say_nothing_about_yaw():
    T = make_transform(Rotation.from_rotvec([1.8, 0, 0]).as_matrix(), np.array([0, 0, 0.5]))
    motion = predict_motion(start_motion(T, NOISE), np.zeros(6), DT, NOISE)
    spun = make_transform(T[:3, :3] @ rotation_about_y(1.0), T[:3, 3])
    corrected = correct_motion(motion, spun, NOISE, symmetric=True)
    np.testing.assert_allclose(corrected.twist, 0, atol=1e-9)
    tipped = make_transform(Rotation.from_rotvec([0.1, 0, 0]).as_matrix() @ spun[:3, :3], T[:3, 3])
    corrected = correct_motion(motion, tipped, NOISE, symmetric=True)
    assert corrected.twist[3] > 0.1
    assert np.abs(corrected.twist[4:]).max() < 1e-9


def test_covariances_stay_symmetric_and_positive():
    motion = start_motion(np.eye(4), NOISE)
    rng = np.random.default_rng(4)
    for _ in range(300):
        motion = predict_motion(motion, rng.normal(0, 0.3, 6), rng.uniform(0.01, 0.3), NOISE)
        motion = correct_motion(motion, motion.T_cam_obj, NOISE)
        for covariance in (motion.linear_covariance, motion.angular_covariance):
            np.testing.assert_allclose(covariance, covariance.T)
            assert np.linalg.eigvalsh(covariance).min() > 0


@pytest.mark.parametrize("name", ["position", "rotation"])
def test_more_noise_means_less_gain(name: str):
    noisy = TargetMotionNoise(**{name: 0.2})
    T = make_transform(np.eye(3), np.array([0, 0, 0.5]))
    seen = make_transform(Rotation.from_rotvec([0, 0, 0.1]).as_matrix(), np.array([0.01, 0, 0.5]))

    def twist(noise: TargetMotionNoise) -> float:
        motion = start_motion(T, NOISE)
        motion = correct_motion(predict_motion(motion, np.zeros(6), DT, noise), seen, noise)
        part = motion.twist[:3] if name == "position" else motion.twist[3:]
        return float(np.linalg.norm(part))

    assert twist(noisy) < 0.2 * twist(NOISE)
