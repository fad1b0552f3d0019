"""The motions keep the bounds that they state, and their derivatives are right."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from robust6dof.geometry.transforms import invert_transform, rotation_error
from robust6dof.synthetic.camera_motion import CameraMotion, twist_along
from robust6dof.synthetic.difficulty import DIFFICULTIES
from robust6dof.synthetic.signals import Event, SmoothNoise, draw_events

ORIGIN = np.zeros(3)


@given(st.integers(0, 10_000), st.floats(0.01, 3.0), st.floats(0.01, 3.0))
@settings(max_examples=20, deadline=None)
def test_smooth_noise_keeps_both_bounds(seed: int, peak: float, rate: float) -> None:
    signal = SmoothNoise.draw(np.random.default_rng(seed), peak, rate)
    # Several periods of the slowest wave that these bounds allow.
    t = np.linspace(0, 40 * np.pi * peak / rate, 600)
    values = np.array([signal(x) for x in t])
    assert np.abs(values).max() <= peak * (1 + 1e-9)
    assert np.abs(np.diff(values)).max() / (t[1] - t[0]) <= rate * (1 + 1e-6)
    assert np.ptp(values) > 0.4 * peak


def test_events_rise_hold_and_fall() -> None:
    event = Event(start=1.0, rise=0.5, hold=2.0)
    t = np.linspace(1.0, 1.5, 1001)
    steepest = np.diff([event(x) for x in t]).max() / (t[1] - t[0])
    assert steepest * event.rise == pytest.approx(Event.STEEPEST, rel=1e-4)
    assert [event(t) for t in (0.9, 1.25, 1.5, 2.5, 3.5, 4.1)] == [0, 0.5, 1, 1, 1, 0]
    rng = np.random.default_rng(0)
    events = draw_events(rng, 60.0, 2.0, rise=(0.1, 0.2), hold=(0.1, 0.2), quiet=1.0)
    assert 10 < len(events) < 40
    assert events[0].start >= 1.0
    assert all(a.end < b.start for a, b in itertools.pairwise(events))
    assert draw_events(rng, 60.0, np.inf, rise=(0.1, 0.2), hold=(0.1, 0.2)) == ()


@pytest.mark.parametrize("name", DIFFICULTIES)
def test_the_camera_looks_down_at_the_target(name: str) -> None:
    difficulty = DIFFICULTIES[name]
    for seed in range(5):
        motion = CameraMotion.draw(np.random.default_rng(seed), difficulty, 10.0)
        for t in np.arange(0, 10, 0.1):
            T_world_cam = motion.T_world_cam(t, ORIGIN)
            target_cam = invert_transform(T_world_cam)[:3, 3]
            distance = float(np.linalg.norm(target_cam))
            assert 0.25 < distance < 1.5
            if not any(event(t) for event in motion.leaves):
                off_axis = np.arctan2(np.linalg.norm(target_cam[:2]), target_cam[2])
                assert off_axis < np.deg2rad(10) + (1 - motion.held) * 1.6 * difficulty.swing + 0.05
                assert T_world_cam[2, 2] < -0.2, "the optical axis points down"
            assert T_world_cam[2, 3] > 0.1, "the camera stays above the table"


@pytest.mark.parametrize("name", DIFFICULTIES)
def test_the_swing_keeps_its_bounds(name: str) -> None:
    """Pitch and roll about the nominal view, bursts and all; and the bounds are nearly used."""
    difficulty = DIFFICULTIES[name]
    t = np.arange(0, 12, 0.02)
    largest = fastest = 0.0
    for seed in range(5):
        motion = CameraMotion.draw(np.random.default_rng(seed), difficulty, 12.0)
        swing = np.array([motion.swing_vector(x) for x in t])[:, [0, 2]]
        largest = max(largest, np.abs(swing).max() / difficulty.swing)
        fastest = max(fastest, np.abs(np.diff(swing, axis=0)).max() / 0.02 / difficulty.swing_rate)
    assert 0.6 < largest <= 1.0
    assert 0.5 < fastest <= 1.0 + 1e-3


def test_leaving_takes_the_target_out_of_view() -> None:
    motions = [
        CameraMotion.draw(np.random.default_rng(s), DIFFICULTIES["harsh"], 20.0) for s in range(6)
    ]
    middles = [(m, e.start + e.rise + e.hold / 2) for m in motions for e in m.leaves]
    assert middles
    for motion, t in middles:
        x, y, z = invert_transform(motion.T_world_cam(t, ORIGIN))[:3, 3]
        assert np.arctan2(np.hypot(x, y), z) > np.deg2rad(30)


def test_twist_is_the_derivative_of_the_transform() -> None:
    motion = CameraMotion.draw(np.random.default_rng(3), DIFFICULTIES["harsh"], 5.0)

    def T_world_cam(t: float) -> np.ndarray:
        return motion.T_world_cam(t, t * np.array([0.2, -0.1, 0.0]))

    dt, t = 1e-3, 2.0
    twist = twist_along(T_world_cam, t)
    T_now_next = invert_transform(T_world_cam(t)) @ T_world_cam(t + dt)
    np.testing.assert_allclose(T_now_next[:3, 3] / dt, twist[:3], atol=0.02)
    rotvec = Rotation.from_matrix(T_now_next[:3, :3]).as_rotvec()
    np.testing.assert_allclose(rotvec / dt, twist[3:], atol=0.05)


def test_harder_means_faster() -> None:
    def median_step(name: str) -> float:
        steps = []
        for seed in range(3):
            motion = CameraMotion.draw(np.random.default_rng(seed), DIFFICULTIES[name], 10.0)
            R = [motion.T_world_cam(t, ORIGIN)[:3, :3] for t in np.arange(0, 5, 1 / 30)]
            steps += [float(rotation_error(a, b)) for a, b in itertools.pairwise(R)]
        return float(np.quantile(steps, 0.9))

    assert median_step("calm") < median_step("agile") < median_step("harsh")
