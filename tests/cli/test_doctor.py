"""`robust6dof doctor` on sound and on spoilt folders: what it says, draws and returns."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from data.nocs_files import make_instances, write_frame, write_pickle
from robust6dof.cli import main
from robust6dof.data import open_dataset, write_sequence
from robust6dof.data.dataset import ObjectTruth
from robust6dof.data.pose_check import pose_problem
from robust6dof.data.truth_file import FILE_NAME, AnnotatedTruth, write_truth_file
from robust6dof.frames import RgbdFrame
from robust6dof.geometry.transforms import make_transform
from shared_data import shared_data

WIDTH, HEIGHT = 160, 120
K = np.array([[150.0, 0, 79.5], [0, 150.0, 59.5], [0, 0, 1]])
EXTENTS = (0.2, 0.16, 0.1)


def make_frame_of_a_box() -> tuple[RgbdFrame, np.ndarray, np.ndarray]:
    """A box, its front 0.75 m away and turned to the camera, before a wall at 1.5 m."""
    T_cam_obj = make_transform(np.diag([1.0, -1.0, -1.0]), np.array([0.05, -0.02, 0.8]))
    x, y = (np.mgrid[:HEIGHT, :WIDTH][::-1] - K[:2, 2, None, None]) / 150.0 * 0.75
    mask = (np.abs(x - 0.05) < EXTENTS[0] / 2) & (np.abs(y + 0.02) < EXTENTS[1] / 2)
    depth = np.where(mask, 0.75, 1.5).astype(np.float32)
    rgb = np.where(mask[..., None], [200, 60, 40], [90, 90, 90]).astype(np.uint8)
    return RgbdFrame(rgb, depth, K), mask, T_cam_obj


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    frame, mask, T_cam_obj = make_frame_of_a_box()
    path = tmp_path / "video"
    write_sequence(path, [frame] * 3, [mask] * 3, [T_cam_obj] * 3)
    return describe(path)


def describe(path: Path) -> Path:
    """Write `ground_truth.jsonl` from the annotated poses."""
    truths = [
        AnnotatedTruth("mug_7", "mug", np.loadtxt(file), np.array(EXTENTS), frame=file.stem)
        for file in sorted((path / "annotated_poses").iterdir())
    ]
    write_truth_file(path / FILE_NAME, truths)
    return path


def doctor(path: Path, capsys: pytest.CaptureFixture[str], *options: str) -> tuple[int, str]:
    picture = path.parent / "picture" / "doctor.png"
    code = main(["doctor", str(path), "--out", str(picture), *options])
    return code, capsys.readouterr().out


def test_a_sound_recording(recording: Path, capsys: pytest.CaptureFixture[str]) -> None:
    code, text = doctor(recording, capsys)
    assert code == 0
    for line in (
        "recordings: 1 sequences, 3 frames",
        "depth: most of it between 1.50 and 1.50 m; 100% to 100%",
        "intrinsics: 160×120",
        "annotated: 3 of 3 frames looked at (mug_7)",
        "masks and poses agree with the depth (3 objects)",
    ):
        assert line in text
    assert "PROBLEM" not in text


def test_the_picture_shows_the_box_where_the_object_is(
    recording: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    doctor(recording, capsys)
    picture = cv2.imread(str(recording.parent / "picture" / "doctor.png"))
    assert picture is not None
    assert picture.shape == (HEIGHT, 2 * WIDTH, 3)
    _, mask, _ = make_frame_of_a_box()
    green = (picture[:, :WIDTH, 1] > 150) & (picture[:, :WIDTH, 2] < 120)
    rows, columns = np.nonzero(green)
    mask_rows, mask_columns = np.nonzero(mask)
    assert abs(columns.mean() - mask_columns.mean()) < 5
    assert abs(columns.min() - mask_columns.min()) < 5
    assert abs(rows.max() - mask_rows.max()) < 5


def test_depth_only_draws_depth_alone(recording: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert doctor(recording, capsys, "--depth-only")[0] == 0
    picture = cv2.imread(str(recording.parent / "picture" / "doctor.png"))
    assert picture is not None
    assert picture.shape == (HEIGHT, WIDTH, 3)


def rewrite_poses(path: Path, change: Callable[[np.ndarray], None]) -> None:
    for file in (path / "annotated_poses").iterdir():
        T_cam_obj = np.loadtxt(file)
        change(T_cam_obj)
        np.savetxt(file, T_cam_obj)
    describe(path)


def in_millimetres(T_cam_obj: np.ndarray) -> None:
    T_cam_obj[:3, 3] *= 1000


def behind(T_cam_obj: np.ndarray) -> None:
    T_cam_obj[2, 3] *= -1


def aside(T_cam_obj: np.ndarray) -> None:
    T_cam_obj[0, 3] -= 0.2


def nearer(T_cam_obj: np.ndarray) -> None:
    T_cam_obj[2, 3] -= 0.25


def outside(T_cam_obj: np.ndarray) -> None:
    T_cam_obj[0, 3] += 3


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (in_millimetres, "are its poses in millimetres?"),
        (behind, "lies behind the camera"),
        (aside, "of the depth in mug_7's mask lies in its box"),
        (nearer, "it is seen at 0.75 m and posed at 0.55 m"),
        (outside, "far outside the image"),
    ],
)
def test_false_poses_are_found(
    recording: Path,
    capsys: pytest.CaptureFixture[str],
    change: Callable[[np.ndarray], None],
    words: str,
) -> None:
    rewrite_poses(recording, change)
    code, text = doctor(recording, capsys)
    assert code == 1
    assert any(line.startswith("PROBLEM") and words in line for line in text.splitlines())


def test_false_masks_are_found(recording: Path, capsys: pytest.CaptureFixture[str]) -> None:
    _, mask, _ = make_frame_of_a_box()
    values = (np.zeros_like(mask), ~mask)
    for name, value in zip(("000000", "000001"), values, strict=True):
        cv2.imwrite(str(recording / "masks" / f"{name}.png"), value.astype(np.uint8) * 255)
    code, text = doctor(recording, capsys)
    assert code == 1
    assert "video/000000: mug_7: its mask is empty" in text
    assert "is it inverted?" in text


def test_wrong_units_and_intrinsics_are_found(
    recording: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    np.savetxt(recording / "cam_K.txt", 2 * K * [[1], [1], [0.5]])
    code, text = doctor(recording, capsys)
    assert (code, "160×120" in text) == (1, True)
    np.savetxt(recording / "cam_K.txt", K)
    for file in (recording / "depth").iterdir():
        cv2.imwrite(str(file), np.full((HEIGHT, WIDTH), 8000, np.uint16))
    code, text = doctor(recording, capsys)
    assert (code, "depth_unit_m=0.0001" in text) == (1, True)


def test_a_pose_without_mask_must_have_something_there() -> None:
    frame, _, T_cam_obj = make_frame_of_a_box()
    extents = np.array(EXTENTS)
    assert pose_problem(frame, ObjectTruth("box", "can", T_cam_obj, extents)) is None
    floating = T_cam_obj.copy()
    floating[0, 3] -= 0.25
    problem = pose_problem(frame, ObjectTruth("box", "can", floating, extents))
    assert problem is not None
    assert "nothing where box is posed" in problem
    hidden = T_cam_obj.copy()
    hidden[2, 3] = 1.2
    assert pose_problem(frame, ObjectTruth("box", "can", hidden, extents)) is None


def test_a_pose_without_size_is_judged_by_its_distance() -> None:
    frame, mask, T_cam_obj = make_frame_of_a_box()
    assert pose_problem(frame, ObjectTruth("box", "can", T_cam_obj, mask=mask)) is None
    T_cam_obj[2, 3] += 0.5
    problem = pose_problem(frame, ObjectTruth("box", "can", T_cam_obj, mask=mask))
    assert problem == "box is seen at 0.75 m but posed at 1.3 m"


def test_a_data_set_lacks_and_contradicts(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Two NOCS objects whose poses were stored in the wrong order."""
    folder = tmp_path / "nocs" / "real_test" / "scene_1"
    instances = make_instances()
    write_frame(folder, "0000", instances)
    code, text = doctor(tmp_path / "nocs", capsys)
    assert code == 0
    assert "nocs-real_test: 1 sequences, 1 frames" in text
    assert "missing in 1 of 1 frames: poses (gts/real_test/results_real_test_scene_1" in text
    bowl, mug = instances[3], instances[0]
    gts = tmp_path / "nocs/gts/real_test/results_real_test_scene_1_0000.pkl"
    write_pickle(gts, {"gt_RTs": np.stack([mug.RT])})
    code, text = doctor(tmp_path / "nocs", capsys)
    assert code == 1
    assert "1 poses for 2 objects" in text
    write_pickle(gts, {"gt_RTs": np.stack([mug.RT, bowl.RT])})
    sizes = tmp_path / "nocs" / "obj_models" / "real_test"
    sizes.mkdir(parents=True)
    for one in instances:
        np.savetxt(sizes / f"{one.model}.txt", one.extents[None])
    code, text = doctor(tmp_path / "nocs", capsys)
    assert code == 1
    assert "scene_1/0000: only 0% of the depth in bowl_white_small_norm's mask" in text


def test_something_else_is_described(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "all" / "shapes").mkdir(parents=True)
    for name in ("a.bin", "b.bin", "list.csv"):
        (tmp_path / "all" / "shapes" / name).touch()
    write_frame(tmp_path / "all" / "scenes" / "real_test" / "scene_1", "0000", make_instances())
    code, text = doctor(tmp_path / "all", capsys)
    assert code == 1
    assert "neither a recording nor a data set that is known" in text
    assert "2 .bin" in text
    assert "look into scenes (nocs)" in text
    assert doctor(tmp_path / "nowhere", capsys)[0] == 1


@pytest.mark.parametrize("name", ["seven_scenes_mugs", "nocs_real275_frame", "ycb_video_frames"])
def test_the_real_recordings_are_sound(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    models = shared_data("ycb_video_poses", "models_points")
    picture = tmp_path / "doctor.png"
    path = shared_data(name)
    assert main(["doctor", str(path), "--out", str(picture), "--models", str(models)]) == 0
    assert picture.is_file()
    assert "PROBLEM" not in capsys.readouterr().out


def test_swapped_poses_of_real_frames_are_found() -> None:
    """Each object posed where another one of the frame is."""
    models = shared_data("ycb_video_poses", "models_points")
    for sequence in open_dataset(shared_data("ycb_video_frames"), models=models).sequences:
        frame, truths = sequence.frame(0), sequence.truth(0)
        for truth, other in zip(truths, truths[1:] + truths[:1], strict=True):
            swapped = ObjectTruth(
                truth.name,
                truth.category,
                other.T_cam_obj,
                truth.extents,
                truth.box_center,
                truth.mask,
            )
            assert pose_problem(frame, truth) is None
            assert pose_problem(frame, swapped) is not None
