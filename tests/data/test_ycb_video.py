"""YCB-Video classic, written as published and its real frames; BOP's is told apart."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
import scipy.io
from scipy.spatial.transform import Rotation

from robust6dof.data import open_dataset
from robust6dof.data.image_files import write_image
from robust6dof.data.ycb_video import K_FIRST, K_SECOND, open_ycb_video, read_keyframes
from robust6dof.errors import DataError
from robust6dof.frames import YCB_OBJECTS
from robust6dof.geometry.camera import backproject
from robust6dof.geometry.transforms import (
    invert_transform,
    make_transform,
    rotation_error,
    transform_points,
)
from shared_data import shared_data

POINTS = np.array([[-0.05, -0.02, 0.0], [0.05, 0.04, 0.1], [0.0, 0.0, 0.05]])


def write_video(folder: Path, class_ids: list[int], frames: tuple[str, ...] = ("000001",)) -> None:
    folder.mkdir(parents=True)
    rotations = Rotation.random(len(class_ids), rng=np.random.default_rng(0)).as_matrix()
    poses = [np.c_[R, [0.1 * i, 0.0, 0.8]] for i, R in enumerate(rotations)]
    label = np.zeros((480, 640), np.uint8)
    for i, class_id in enumerate(class_ids):
        label[100:150, 100 * i + 20 : 100 * i + 80] = class_id
    for name in frames:
        write_image(folder / f"{name}-color.png", np.full((480, 640, 3), 90, np.uint8))
        write_image(folder / f"{name}-depth.png", np.full((480, 640), 8000, np.uint16))
        write_image(folder / f"{name}-label.png", label)
        meta = {
            "cls_indexes": np.array(class_ids, np.uint8)[:, None],
            # As MATLAB does: the last dimension is dropped where it is one.
            "poses": poses[0] if len(poses) == 1 else np.stack(poses, axis=-1),
            "factor_depth": np.uint16(10000),
            "intrinsic_matrix": K_FIRST,
            "vertmap": np.zeros((2, 2, 3), np.float32),
        }
        scipy.io.savemat(folder / f"{name}-meta.mat", meta)


@pytest.fixture
def ycb_video(tmp_path: Path) -> Path:
    write_video(tmp_path / "data" / "0048", [8, 14, 21], ("000001", "000010", "000002"))
    write_video(tmp_path / "data" / "0001", [1])
    points = tmp_path / "models" / "025_mug" / "points.xyz"
    points.parent.mkdir(parents=True)
    np.savetxt(points, POINTS)
    keyframes = tmp_path / "image_sets" / "keyframe.txt"
    keyframes.parent.mkdir()
    keyframes.write_text("0048/000001\n0048/000010\n0049/000005\n")
    return tmp_path


def test_frames_and_truth(ycb_video: Path) -> None:
    sequence = open_ycb_video(ycb_video).sequence("0048")
    assert sequence.frame_names == ("000001", "000002", "000010")
    frame = sequence.frame(0)
    np.testing.assert_allclose(frame.depth, 0.8)
    np.testing.assert_array_equal(frame.K, K_FIRST)
    truths = sequence.truth(0)
    assert [truth.name for truth in truths] == ["009_gelatin_box", "025_mug", "061_foam_brick"]
    np.testing.assert_allclose([truth.T_cam_obj[0, 3] for truth in truths], [0.0, 0.1, 0.2])
    mug = truths[1]
    assert mug.mask is not None
    assert mug.mask.sum() == 50 * 60
    assert mug.mask[120, 150]
    assert truths[0].extents is None


def test_extents_and_their_centre_come_from_the_model(ycb_video: Path) -> None:
    mug = open_ycb_video(ycb_video).sequence("0048").truth(0)[1]
    np.testing.assert_allclose(mug.extents, [0.1, 0.06, 0.1])
    np.testing.assert_allclose(mug.box_center, [0.0, 0.01, 0.05])
    corner = transform_points(mug.T_cam_box, mug.extents / 2)
    np.testing.assert_allclose(corner, transform_points(mug.T_cam_obj, POINTS[1]))


def test_a_single_object_keeps_its_pose(ycb_video: Path) -> None:
    (truth,) = open_ycb_video(ycb_video).sequence("0001").truth(0)
    assert truth.name == YCB_OBJECTS[0]
    np.testing.assert_allclose(truth.T_cam_obj[:3, 3], [0.0, 0.0, 0.8])


def test_splits_and_keyframes(ycb_video: Path) -> None:
    names = {
        split: [sequence.name for sequence in open_ycb_video(ycb_video, split).sequences]
        for split in ("all", "train", "test")
    }
    assert names == {"all": ["0001", "0048"], "train": ["0001"], "test": ["0048"]}
    expected = {"0048": ("000001", "000010"), "0049": ("000005",)}
    assert read_keyframes(ycb_video) == expected
    (ycb_video / "image_sets" / "keyframe.txt").write_text("48/1\n")
    with pytest.raises(DataError, match="no video/frame"):
        read_keyframes(ycb_video)


@pytest.mark.parametrize(("video", "K"), [("0059", K_FIRST), ("0060", K_SECOND)])
def test_intrinsics_without_meta_go_by_the_video(tmp_path: Path, video: str, K: np.ndarray) -> None:
    write_video(tmp_path / video, [1])
    (tmp_path / video / "000001-meta.mat").unlink()
    for path in (tmp_path, tmp_path / video):
        (sequence,) = open_ycb_video(path).sequences
        np.testing.assert_array_equal(sequence.frame(0).K, K)
        assert sequence.truth(0) == ()


def test_unknown_intrinsics_are_refused(tmp_path: Path) -> None:
    write_video(tmp_path / "frames", [1])
    (tmp_path / "frames" / "000001-meta.mat").unlink()
    with pytest.raises(DataError, match="Rename the folder"):
        open_ycb_video(tmp_path / "frames").sequences[0].frame(0)


def test_false_meta_files_are_named(ycb_video: Path) -> None:
    folder = ycb_video / "data" / "0048"
    meta = folder / "000001-meta.mat"
    sequence = open_ycb_video(ycb_video).sequence("0048")
    content = scipy.io.loadmat(meta, variable_names=["cls_indexes", "poses"])
    meta.write_bytes(meta.read_bytes()[:300])
    with pytest.raises(DataError, match=r"000001-meta\.mat: unreadable"):
        sequence.truth(0)
    kept = {key: value for key, value in content.items() if not key.startswith("_")}
    scipy.io.savemat(meta, kept)
    with pytest.raises(DataError, match="it lacks factor_depth, intrinsic_matrix"):
        sequence.frame(0)
    kept |= {"factor_depth": 10000, "intrinsic_matrix": K_FIRST}
    scipy.io.savemat(meta, kept | {"cls_indexes": [[1], [2]]})
    with pytest.raises(DataError, match=r"3 poses for classes \[1, 2\]"):
        sequence.truth(0)
    scipy.io.savemat(meta, kept | {"poses": 2 * kept["poses"]})
    with pytest.raises(DataError, match="not a rotation"):
        sequence.truth(0)


def test_bop_is_told_apart(tmp_path: Path) -> None:
    scene = tmp_path / "test" / "000048"
    (scene / "rgb").mkdir(parents=True)
    (scene / "scene_gt.json").write_text("{}")
    for path in (tmp_path, scene.parent, scene):
        with pytest.raises(DataError, match=r"BOP's ycbv.*classic YCB-Video"):
            open_ycb_video(path)
    with pytest.raises(DataError, match="BOP's ycbv"):
        open_dataset(tmp_path)
    with pytest.raises(DataError, match="BOP's ycbv"):
        open_dataset(scene)


def test_a_foreign_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no videos of YCB-Video"):
        open_ycb_video(tmp_path)


@pytest.mark.parametrize("video", ["0000", "0014"])
def test_real_frames_agree_with_their_truth(video: str) -> None:
    """Masked depth, moved into the object frame, lies in the object's box."""
    models = shared_data("ycb_video_poses", "models_points")
    sequence = open_ycb_video(shared_data("ycb_video_frames"), models=models).sequence(video)
    for index in range(len(sequence)):
        frame = sequence.frame(index)
        for truth in sequence.truth(index):
            assert truth.extents is not None
            points, _ = backproject(frame.depth, frame.K, truth.mask)
            points_box = transform_points(invert_transform(truth.T_cam_box), points)
            inside = (np.abs(points_box) < truth.extents / 2 + 0.01).all(axis=1)
            assert inside.mean() > 0.93, truth.name


def test_real_truth_agrees_with_the_pose_lists() -> None:
    path = shared_data("ycb_video_poses", "ycbv_gt_poses_by_video.npz")
    sequence = open_ycb_video(shared_data("ycb_video_frames")).sequence("0000")
    with np.load(path) as lists:
        for truth in sequence.truth(1):
            row = lists[f"0000/{truth.name}"][1]
            R = Rotation.from_quat(row[[1, 2, 3, 0]]).as_matrix()
            expected = make_transform(R, row[4:])
            np.testing.assert_allclose(truth.T_cam_obj[:3, 3], expected[:3, 3], atol=1e-5)
            assert rotation_error(truth.T_cam_obj[:3, :3], R) < 1e-3


def test_real_frames_without_annotations_load_once_named(tmp_path: Path) -> None:
    source = shared_data("ycb_video_frames", "test_frames")
    reference = json.loads((source.parent / "reference_poses.json").read_text())
    target = tmp_path / "0050"
    target.mkdir()
    for kind in ("color", "depth"):
        (target / f"000001-{kind}.png").write_bytes((source / f"000001-{kind}.png").read_bytes())
    (sequence,) = open_ycb_video(tmp_path).sequences
    frame = sequence.frame(0)
    # In 0001-steps: read in millimetres the mustard bottle would be 8 m away.
    *_, x, y, z = reference["frames"]["test_frames/000001"]["poses"]["006_mustard_bottle"]
    column, row = np.rint(frame.K[:2] @ [x / z, y / z, 1]).astype(int)
    assert abs(frame.depth[row, column] - z) < 0.06
