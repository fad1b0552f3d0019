"""Wild6D, written by the tests as it is published."""

from __future__ import annotations

import json
import pickle
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from robust6dof.data import open_dataset
from robust6dof.data.image_files import write_image
from robust6dof.data.wild6d import open_wild6d
from robust6dof.errors import DataError

K = np.array([[550.0, 0, 238.0], [0, 551.0, 322.0], [0, 0, 1]])
ROTATION = Rotation.from_euler("xyz", [0.2, 0.4, 3.0]).as_matrix()


@pytest.fixture
def wild6d(tmp_path: Path) -> Path:
    """Twelve portrait frames, annotations for eleven, no mask for frame 2."""
    video = tmp_path / "test_set" / "laptop" / "0003" / "1"
    (video / "images").mkdir(parents=True)
    for i in range(12):
        stem = video / "images" / str(i)
        write_image(stem.with_name(f"{i}.jpg"), np.full((640, 480, 3), 5 * i, np.uint8))
        write_image(stem.with_name(f"{i}-depth.png"), np.full((640, 480), 700 + i, np.uint16))
        if i != 2:
            mask = np.zeros((640, 480, 3), np.uint8)
            mask[200 : 300 + i, 100:200] = 255
            write_image(stem.with_name(f"{i}-mask.png"), mask)
    (video / "metadata").write_text(json.dumps({"K": K.T.ravel().tolist(), "w": 480, "h": 640}))
    annotations = [
        {
            "class_id": 5,
            "rotation": ROTATION,
            "translation": np.array([0.01 * i, 0.0, 0.7]),
            "size": np.array([0.3, 0.2, 0.25]),
            "name": f"laptop/0003/1/{i}",
        }
        for i in range(11)
    ]
    file = tmp_path / "test_set" / "pkl_annotations" / "laptop" / "laptop-0003-1.pkl"
    file.parent.mkdir(parents=True)
    file.write_bytes(pickle.dumps({"annotations": annotations}))
    return tmp_path


def test_frames_in_number_order_with_column_major_intrinsics(wild6d: Path) -> None:
    for path in (wild6d, wild6d / "test_set"):
        (sequence,) = open_wild6d(path).sequences
        assert sequence.name == "laptop/0003/1"
        assert sequence.frame_names == tuple(str(i) for i in range(12))
        frame = sequence.frame(10)
        assert (frame.width, frame.height) == (480, 640)
        np.testing.assert_array_equal(frame.K, K)
        np.testing.assert_allclose(frame.depth, 0.71, atol=1e-6)
    assert open_dataset(wild6d).name == "wild6d"


def test_truth_goes_by_frame_number(wild6d: Path) -> None:
    (sequence,) = open_wild6d(wild6d).sequences
    (truth,) = sequence.truth(10)
    np.testing.assert_allclose(truth.T_cam_obj[:3, :3], ROTATION)
    np.testing.assert_allclose(truth.T_cam_obj[:3, 3], [0.1, 0.0, 0.7])
    np.testing.assert_array_equal(truth.extents, [0.3, 0.2, 0.25])
    assert (truth.name, truth.category) == ("laptop-0003-1", "laptop")
    assert truth.mask is not None
    assert truth.mask.sum() == 110 * 100
    assert truth.handle_visible


def test_frames_past_the_annotations_or_without_mask_have_no_truth(wild6d: Path) -> None:
    (sequence,) = open_wild6d(wild6d).sequences
    assert sequence.truth(2) == ()
    assert sequence.truth(11) == ()
    next(wild6d.glob("**/laptop-0003-1.pkl")).unlink()
    assert open_wild6d(wild6d).sequences[0].truth(0) == ()


def test_row_major_intrinsics_are_refused(wild6d: Path) -> None:
    metadata = next(wild6d.glob("**/metadata"))
    metadata.write_text(json.dumps({"K": K.ravel().tolist()}))
    with pytest.raises(DataError, match="row by row"):
        open_wild6d(wild6d).sequences[0].frame(0)
    metadata.write_text("{}")
    with pytest.raises(DataError, match="no JSON with nine numbers K"):
        open_wild6d(wild6d).sequences[0].frame(0)
    metadata.unlink()
    with pytest.raises(DataError, match=r"metadata: the file is missing"):
        open_wild6d(wild6d).sequences[0].frame(0)


def test_false_annotations_are_named(wild6d: Path) -> None:
    file = next(wild6d.glob("**/laptop-0003-1.pkl"))
    file.write_bytes(pickle.dumps({"annotations": [{"rotation": 2 * ROTATION}]}))
    with pytest.raises(DataError, match=r"laptop-0003-1\.pkl: annotation 0"):
        open_wild6d(wild6d).sequences[0].truth(0)
    file.write_bytes(pickle.dumps([1, 2]))
    with pytest.raises(DataError, match="it lacks annotations"):
        open_wild6d(wild6d).sequences[0].truth(0)


def test_a_foreign_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no videos of Wild6D"):
        open_wild6d(tmp_path)
