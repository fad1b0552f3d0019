"""Recordings as a data set: YCBInEOAT, one's own, and those whose maker described the object."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from data.recordings import make_mask, make_recording, make_T_cam_obj
from robust6dof.data import open_dataset
from robust6dof.data.recordings import open_recordings
from robust6dof.errors import DataError, InputError
from shared_data import shared_data


def test_ycbineoat_knows_its_objects(tmp_path: Path) -> None:
    for name in ("mustard0", "bleach_hard_00_03_chaitanya"):
        make_recording(tmp_path / name)
        for index, file in enumerate(sorted((tmp_path / name / "annotated_poses").iterdir())):
            file.rename(file.with_name(f"{index + 100000}.txt"))
    dataset = open_recordings(tmp_path)
    assert dataset.name == "ycbineoat"
    assert [s.name for s in dataset.sequences] == ["bleach_hard_00_03_chaitanya", "mustard0"]
    sequence = dataset.sequence("mustard0")
    assert len(sequence) == 3
    assert sequence.frame(1).name == "100"
    (truth,) = sequence.truth(1)
    assert (truth.name, truth.category) == ("006_mustard_bottle", "006_mustard_bottle")
    assert truth.extents is None
    np.testing.assert_array_equal(truth.mask, make_mask(1))


def test_other_videos_are_not_ycbineoat(tmp_path: Path) -> None:
    make_recording(tmp_path / "kitchen")
    dataset = open_dataset(tmp_path)
    assert dataset.name == "recordings"
    (truth,) = dataset.sequences[0].truth(0)
    assert (truth.name, truth.category) == ("object_0", "unknown")
    with pytest.raises(InputError, match="no sequence 'x'; it has: kitchen"):
        dataset.sequence("x")


def test_recordings_are_found_however_deep(tmp_path: Path) -> None:
    for name in ("run_10", "run_2"):
        make_recording(tmp_path / "deep" / name)
    dataset = open_recordings(tmp_path)
    assert [s.name for s in dataset.sequences] == ["deep/run_2", "deep/run_10"]
    (truth,) = dataset.sequence("deep/run_2").truth(2)
    np.testing.assert_allclose(truth.T_cam_obj, make_T_cam_obj(2), atol=1e-8)
    assert dataset.sequences[0].missing(0) == ("stamps.txt",)


def test_frames_without_annotation_have_no_truth() -> None:
    dataset = open_dataset(shared_data("seven_scenes_mugs"), depth_only=True)
    (sequence,) = dataset.sequences
    assert len(sequence) == 212
    assert sequence.truth(5) == ()
    assert not sequence.frame(5).has_color


def test_a_folder_of_something_else_says_what_was_looked_for(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"neither.*rgb/.*NOCS.*YCB-Video.*Wild6D"):
        open_dataset(tmp_path)
    with pytest.raises(DataError, match="no such folder"):
        open_dataset(tmp_path / "x")
