"""The first loop: what a tracker is told, what is stored, how a run is taken up again."""

import json
from pathlib import Path

import numpy as np
import pytest

from evaluation.small_recordings import (
    EXTENTS,
    StandingTracker,
    make_lost,
    make_standing,
    true_pose,
    write_recording,
)
from robust6dof.data.track_file import read_tracks
from robust6dof.data.truth_file import FILE_NAME, open_with_truth, read_truth_file
from robust6dof.errors import DataError, InputError
from robust6dof.evaluation.follow import predict_sequence
from robust6dof.evaluation.predict import predict
from robust6dof.evaluation.run_info import RunInfo
from robust6dof.evaluation.run_records import records_of_run


@pytest.fixture
def data(tmp_path):
    write_recording(tmp_path / "data" / "a", hidden=(("can_0", 0),))
    write_recording(tmp_path / "data" / "b", frames=3)
    return tmp_path / "data"


def info(data, protocol="ycbv-auc", seed=0):
    return RunInfo("standing", protocol, str(data), seed)


def test_truth_file_round_trip(data):
    truths = read_truth_file(data / "a" / FILE_NAME)
    assert len(truths) == 10
    can = truths[1]
    assert (can.name, can.category, can.symmetric, can.visible_fraction) == (
        "can_0",
        "can",
        True,
        0.0,
    )
    np.testing.assert_allclose(can.T_cam_obj, true_pose(0, "can_0"))
    fields = json.loads((data / "a" / FILE_NAME).read_text().splitlines()[0])
    assert {"frame", "stamp", "object", "category", "T_cam_obj", "extents_m"} <= fields.keys()
    assert {"visibility", "handle_visible", "symmetric"} <= fields.keys()


def test_truth_file_with_a_bad_line_is_refused(tmp_path):
    path = tmp_path / FILE_NAME
    path.write_text('{"frame": "0"}\n')
    with pytest.raises(DataError, match="line 1 is not a truth"):
        read_truth_file(path)


def test_a_tracker_is_told_its_start_and_nothing_more(data):
    trackers = []

    def make(category, cad, exact_start):
        trackers.append(StandingTracker(category))
        return trackers[-1]

    sequence = open_with_truth(data).sequence("a")
    outcome = predict_sequence(sequence, make, info(data), data.parent / "run" / "a")
    mug, can = trackers
    assert outcome.started == {"mug_0": "000000", "can_0": "000001"}
    assert [len(t.hints) for t in trackers] == [1, 1]
    name, mask, T_cam_obj, extents = can.hints[0]
    assert name == "000001"  # hidden on the frame before
    assert mask.sum() == 100
    np.testing.assert_allclose(T_cam_obj, true_pose(1, "can_0"))
    np.testing.assert_allclose(extents, EXTENTS)
    assert mug.category == "mug"


@pytest.mark.parametrize("protocol", ["aerial", "captra", "6pack"])
def test_starts_are_noisy_where_the_protocol_says_so_and_repeat(data, protocol):
    stored = []
    for run in ("x", "y", "other"):
        settings = info(data, protocol, seed=int(run == "other"))
        assert list(predict(make_standing, settings, data.parent / run)) == ["a", "b"]
        rows = read_tracks(data.parent / run / "a" / "mug_0" / "track.jsonl")
        stored.append(next(iter(rows)).track.T_cam_obj)
    assert 0 < np.linalg.norm(stored[0][:3, 3] - true_pose(0, "mug_0")[:3, 3]) < 0.3
    np.testing.assert_array_equal(stored[0], stored[1])
    assert not np.allclose(stored[0], stored[2])


def test_run_becomes_records_with_missing_and_lost_frames(data):
    run = data.parent / "run"
    list(predict(make_lost, info(data), run))
    records = records_of_run(run, open_with_truth(data, with_masks=False))
    assert len(records) == 2 * (5 + 3)
    by_key = {(r.sequence, r.object, r.frame): r for r in records}
    assert by_key["a", "can_0", 0].T_cam_obj is None
    assert by_key["a", "can_0", 2].lost
    assert not by_key["a", "can_0", 4].lost
    record = by_key["a", "mug_0", 4]
    np.testing.assert_allclose(record.T_cam_obj, true_pose(0, "mug_0"))
    np.testing.assert_allclose(record.T_cam_obj_true, true_pose(4, "mug_0"))
    assert (record.difficulty, record.frame_name, record.visibility) == ("easy", "000004", 0.9)


def test_finished_sequences_are_not_done_again(data):
    run = data.parent / "run"
    assert list(predict(make_standing, info(data), run, sequences=("b",))) == ["b"]
    track = run / "b" / "mug_0" / "track.jsonl"
    written = track.stat().st_mtime_ns
    assert list(predict(make_standing, info(data), run)) == ["a"]
    assert track.stat().st_mtime_ns == written
    assert list(predict(make_standing, info(data), run)) == []


def test_a_sequence_cut_short_is_begun_again(data):
    run = data.parent / "run"
    list(predict(make_standing, info(data), run))
    track = run / "a" / "mug_0" / "track.jsonl"
    whole = [line.split('"ms"')[0] for line in track.read_text().splitlines()]
    (run / "a" / "done.json").unlink()
    track.write_text(track.read_text()[:-40])
    assert list(predict(make_standing, info(data), run)) == ["a"]
    assert [line.split('"ms"')[0] for line in track.read_text().splitlines()] == whole


def test_a_folder_with_another_run_is_refused(data):
    run = data.parent / "run"
    list(predict(make_standing, info(data), run))
    with pytest.raises(InputError, match="holds another run"):
        list(predict(make_standing, info(data, seed=1), run))


def test_a_run_that_failed_before_it_stored_anything_does_not_claim_its_folder(data):
    def make_nothing(category, **_):
        raise InputError("no such tracker")

    run = data.parent / "run"
    with pytest.raises(InputError, match="no such tracker"):
        list(predict(make_nothing, info(data, seed=1), run))
    assert list(predict(make_standing, info(data), run)) == ["a", "b"]


def test_a_tracker_that_cannot_start_leaves_its_frames_missing(data):
    class Refusing(StandingTracker):
        def start(self, frame, **hints):
            raise InputError("no depth on the object")

    def make(category, cad, exact_start):
        return (Refusing if category == "can" else StandingTracker)(category)

    run = data.parent / "run"
    list(predict(make, info(data), run))
    done = json.loads((run / "a" / "done.json").read_text())
    assert done["failed"] == {"can_0": "no depth on the object"}
    records = records_of_run(run, open_with_truth(data))
    assert {r.category for r in records if r.T_cam_obj is None} == {"can"}


def test_several_workers_store_the_same(data):
    for run, workers in (("one", 1), ("two", 2)):
        list(predict(make_standing, info(data), Path(data.parent / run), processes=workers))
    for name in ("a", "b"):
        files = [data.parent / run / name / "can_0" / "track.jsonl" for run in ("one", "two")]
        first, second = ([r.track.T_cam_obj for r in read_tracks(file)] for file in files)
        np.testing.assert_array_equal(first, second)
