"""Integrated rates follow the true turn, and what is not in rad/s is refused."""

from collections.abc import Callable

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from robust6dof.errors import InputError
from robust6dof.geometry.gyro import integrate_rates, turned
from robust6dof.geometry.transforms import rotation_error


def swaying(time: float) -> np.ndarray:
    """An orientation that turns about changing axes."""
    angles = [0.8 * np.sin(3 * time), 0.5 * np.cos(2 * time), 0.9 * time]
    return Rotation.from_euler("xyz", angles).as_matrix()


def rates_of(R_ref_cam: Callable[[float], np.ndarray], stamps: np.ndarray) -> np.ndarray:
    """Angular velocities in camera axes, by central differences."""
    turns = [R_ref_cam(t - 1e-5).T @ R_ref_cam(t + 1e-5) for t in stamps]
    return Rotation.from_matrix(np.array(turns)).as_rotvec() / 2e-5


def test_the_turn_between_two_frames_is_the_true_one() -> None:
    stamps = np.arange(0.0, 2.0, 0.005)
    frames = np.array([0.0, 0.0333, 0.1012, 1.7])
    found = integrate_rates(stamps, rates_of(swaying, stamps), frames)
    for R_ref_cam, time in zip(found, frames, strict=True):
        assert R_ref_cam is not None
        true = swaying(frames[0]).T @ swaying(time)
        assert rotation_error(R_ref_cam, true) < 2e-4


def test_sample_by_sample_is_the_same_as_all_at_once() -> None:
    rate, R_ref_cam = np.array([0.3, -2.0, 1.1]), np.eye(3)
    for _ in range(10):
        R_ref_cam = turned(R_ref_cam, rate, 0.02)
    (at_once,) = integrate_rates(np.array([0.0, 0.2]), np.stack([rate, rate]), np.array([0.2]))
    assert at_once is not None
    np.testing.assert_allclose(R_ref_cam, at_once, atol=1e-12)
    np.testing.assert_allclose(R_ref_cam, Rotation.from_rotvec(0.2 * rate).as_matrix(), atol=1e-12)


def test_nothing_is_said_of_the_time_before_and_after() -> None:
    found = integrate_rates(np.array([1.0, 2.0]), np.zeros((2, 3)), np.array([0.9, 1.0, 2.0, 2.1]))
    assert [one is None for one in found] == [True, False, False, True]


@pytest.mark.parametrize(
    ("rate", "words"),
    [
        (np.array([90.0, 0.0, 0.0]), "degrees per second"),
        (np.array([np.nan, 0.0, 0.0]), "NaN"),
    ],
)
def test_what_no_gyro_measures_is_refused(rate: np.ndarray, words: str) -> None:
    with pytest.raises(InputError, match=words):
        turned(np.eye(3), rate, 0.01)
