"""`gyro.csv` gives the frames of a recording their orientations, or says what is wrong with it."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from data.recordings import make_recording
from robust6dof.data import read_video
from robust6dof.data.gyro import write_gyro
from robust6dof.errors import DataError

RATE = np.array([0.4, -0.2, 0.1])
TIMES = np.arange(0.95, 1.3, 0.01)


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """Three frames, 0.1 s apart, under constant rotation."""
    path = make_recording(tmp_path / "recording")
    (path / "stamps.txt").write_text("1.0\n1.1\n1.2\n")
    write_gyro(path, TIMES, np.tile(RATE, (len(TIMES), 1)))
    return path


def turn(path: Path, a: int, b: int, depth_only: bool = False) -> np.ndarray:
    """Rotation vector of the turn from one frame to another, camera axes."""
    first, second = (read_video(path, depth_only=depth_only)[i].R_ref_cam for i in (a, b))
    assert first is not None
    assert second is not None
    return Rotation.from_matrix(first.T @ second).as_rotvec()


def test_frames_know_how_the_camera_turned(recording: Path) -> None:
    np.testing.assert_allclose(turn(recording, 0, 1), 0.1 * RATE, atol=1e-6)
    np.testing.assert_allclose(turn(recording, 0, 2), 0.2 * RATE, atol=1e-6)
    later = read_video(recording)[1:]
    np.testing.assert_array_equal(later[0].R_ref_cam, read_video(recording)[1].R_ref_cam)


def test_without_a_gyro_nothing_is_known(recording: Path) -> None:
    (recording / "gyro.csv").unlink()
    assert [frame.R_ref_cam for frame in read_video(recording)] == [None] * 3
    assert read_video(recording)[1:][0].R_ref_cam is None


def test_frames_outside_its_time_have_none(recording: Path) -> None:
    kept = TIMES > 1.05
    write_gyro(recording, TIMES[kept], np.zeros((kept.sum(), 3)))
    known = [frame.R_ref_cam is not None for frame in read_video(recording)]
    assert known == [False, True, True]


def test_other_axes_are_turned_to_the_cameras(recording: Path) -> None:
    R_cam_gyro = Rotation.from_euler("xyz", [0.3, -1.2, 2.0])
    np.savetxt(recording / "R_cam_gyro.txt", R_cam_gyro.as_matrix())
    np.testing.assert_allclose(turn(recording, 0, 1), 0.1 * R_cam_gyro.apply(RATE), atol=1e-6)
    np.savetxt(recording / "R_cam_gyro.txt", 2 * np.eye(3))
    with pytest.raises(DataError, match="not a rotation"):
        read_video(recording)


def test_the_depth_cameras_axes_are_its_own(recording: Path) -> None:
    K = read_video(recording).calibration.K
    T_color_depth = np.eye(4)
    R_color_depth = Rotation.from_euler("z", 90, degrees=True)
    T_color_depth[:3, :3] = R_color_depth.as_matrix()
    np.savetxt(recording / "T_color_depth.txt", T_color_depth)
    np.savetxt(recording / "cam_K_depth.txt", K)
    found = turn(recording, 0, 1, depth_only=True)
    np.testing.assert_allclose(found, 0.1 * R_color_depth.inv().apply(RATE), atol=1e-6)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "two samples"),
        ("stamp,wx,wy,wz\n1,0,0,0\n", "two samples"),
        ("1,0,0\n1.1,0,0\n", "not a gyro's samples"),
        ("1,0,0,up\n1.1,0,0,0\n", "not a gyro's samples"),
        ("1,0,0,nan\n1.05,0,0,0\n", "NaN"),
        ("nan,0,0,0\n1.05,0,0,0\n", "do not increase"),
        ("1,0,0,0\n1.05,0,0,0\n1.04,0,0,0\n", "do not increase"),
        ("1,0,0,0\n1.5,0,0,0\n", "nothing for 0.50 s"),
        ("1,0,40,0\n1.05,0,0,0\n", "degrees per second"),
        ("1,0,9,0\n1.05,0,9,0\n1.1,0,9,0\n", "degrees per second"),
        ("7,0,0,0\n7.05,0,0,0\n", "another clock"),
    ],
)
def test_what_cannot_be_a_gyro_of_these_frames_is_refused(
    recording: Path, text: str, words: str
) -> None:
    (recording / "gyro.csv").write_text(text)
    with pytest.raises(DataError, match=words) as caught:
        read_video(recording)
    assert caught.value.path.name == "gyro.csv"


def test_frames_without_a_time_are_refused(recording: Path) -> None:
    (recording / "stamps.txt").unlink()
    with pytest.raises(DataError, match=r"Write stamps\.txt"):
        read_video(recording)
