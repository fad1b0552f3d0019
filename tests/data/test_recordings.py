"""Recordings as a data set: YCBInEOAT, one's own, and those whose maker described the object."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from data.recordings import make_mask, make_recording, make_T_cam_obj
from robust6dof.data import open_dataset
from robust6dof.data.object_card import ObjectCard, write_object_card
from robust6dof.data.recordings import open_recordings, open_ycbineoat
from robust6dof.errors import DataError, InputError
from shared_data import shared_data


def test_ycbineoat_knows_its_objects(tmp_path: Path) -> None:
    for name in ("mustard0", "bleach_hard_00_03_chaitanya"):
        make_recording(tmp_path / name)
        for index, file in enumerate(sorted((tmp_path / name / "annotated_poses").iterdir())):
            file.rename(file.with_name(f"{index + 100000}.txt"))
    dataset = open_ycbineoat(tmp_path)
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
    with pytest.raises(DataError, match=r"kitchen: not one of YCBInEOAT's videos"):
        open_ycbineoat(tmp_path)
    dataset = open_dataset(tmp_path)
    assert dataset.name == "recordings"
    (truth,) = dataset.sequences[0].truth(0)
    assert (truth.name, truth.category) == ("object_0", "unknown")
    with pytest.raises(InputError, match="no sequence 'x'; it has: kitchen"):
        dataset.sequence("x")


def test_the_object_card_tells_what_the_poses_do_not(tmp_path: Path) -> None:
    folder = make_recording(tmp_path / "deep" / "run_2")
    make_recording(tmp_path / "deep" / "run_10")
    card = ObjectCard("mug_7", "mug", (0.12, 0.1, 0.08), {"100": False}, {"97": 0.25})
    write_object_card(folder, card)
    dataset = open_recordings(tmp_path)
    assert [s.name for s in dataset.sequences] == ["deep/run_2", "deep/run_10"]
    truths = [dataset.sequence("deep/run_2").truth(i)[0] for i in range(3)]
    assert {(truth.name, truth.category) for truth in truths} == {("mug_7", "mug")}
    np.testing.assert_array_equal(truths[0].extents, card.extents_m)
    np.testing.assert_allclose(truths[2].T_cam_obj, make_T_cam_obj(2), atol=1e-8)
    assert [truth.handle_visible for truth in truths] == [True, False, True]
    assert [truth.visible_fraction for truth in truths] == [0.25, None, None]


@pytest.mark.parametrize("text", ["mug", "[]", '{"name": "a"}', '{"name": "a", "size": 3}'])
def test_false_object_cards_are_named(tmp_path: Path, text: str) -> None:
    folder = make_recording(tmp_path / "a")
    (folder / "object.json").write_text(text)
    with pytest.raises(DataError, match=r"object\.json: not a description"):
        open_recordings(tmp_path)


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
