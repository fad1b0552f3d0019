"""Parts of a data set, runs on them, estimates of single frames, meshes for the oracle."""

import json
from dataclasses import replace

import numpy as np
import pytest
import trimesh

from evaluation.small_recordings import OBJECTS, StandingTracker, make_standing, write_recording
from robust6dof.data.truth_file import open_with_truth
from robust6dof.errors import InputError
from robust6dof.evaluation.cad_models import find_cad_mesh
from robust6dof.evaluation.evaluate import read_stored, score_stored
from robust6dof.evaluation.frame_choice import FrameChoice
from robust6dof.evaluation.predict import predict
from robust6dof.evaluation.protocols import PROTOCOLS
from robust6dof.evaluation.run_info import RunInfo
from robust6dof.shapes.procedural import make_object


@pytest.fixture
def data(tmp_path):
    for name in ("a", "b"):
        write_recording(tmp_path / "data" / name, frames=6)
    return tmp_path / "data"


def make_refusing(category, **_):
    class Refusing(StandingTracker):
        def start(self, frame, **hints):
            raise InputError("no depth on it")

    return (Refusing if category == "can" else StandingTracker)(category)


def run_info(data, **settings):
    return RunInfo("standing", "ycbv-auc", str(data), 0, **settings)


@pytest.mark.parametrize(
    ("choice", "kept"),
    [
        (FrameChoice(), [0, 1, 2, 3, 4, 5]),
        (FrameChoice(every=2), [0, 2, 4]),
        (FrameChoice(drop=3), [0, 4, 5]),
        (FrameChoice(drop=1, most=2), [0, 2]),
        (FrameChoice(drop=9), [0]),
    ],
)
def test_which_frames_are_chosen(choice, kept):
    assert choice.indices(6) == kept


@pytest.mark.parametrize("wrong", [{"every": 0}, {"drop": -1}, {"most": 0}])
def test_choices_that_leave_nothing_are_refused(wrong):
    with pytest.raises(InputError, match="count from 1"):
        FrameChoice(**wrong)


def test_a_run_on_part_of_the_frames_is_scored_on_that_part(data):
    run = data.parent / "run"
    list(predict(make_standing, run_info(data, drop=2), run))
    (stored,) = read_stored(run, PROTOCOLS["captra"])
    names = {record.frame_name for record in stored.records}
    assert names == {"000000", "000003", "000004", "000005"}
    assert all(record.T_cam_obj is not None for record in stored.records)
    scores = score_stored(stored, PROTOCOLS["captra"])
    assert any("2 dropped after the first" in note for note in scores.notes)
    low, high = scores.details["interval95"]["T_err_cm"]
    assert low <= scores.mean["T_err_cm"] <= high


def test_what_a_run_has_not_finished_is_missing_and_is_said(data):
    run = data.parent / "run"
    list(predict(make_standing, run_info(data), run, sequences=("b",)))
    (whole,) = read_stored(run, PROTOCOLS["6pack"])
    assert sum(record.T_cam_obj is None for record in whole.records) == 2 * 6
    assert "1 of 2 sequences are not finished in this run" in whole.remarks[0]
    (part,) = read_stored(run, PROTOCOLS["6pack"], sequences=("b",))
    assert {record.sequence for record in part.records} == {"b"}
    assert part.remarks == ()


def test_objects_that_could_not_be_started_are_said(data):
    run = data.parent / "run"
    list(predict(make_refusing, run_info(data), run))
    (stored,) = read_stored(run, PROTOCOLS["6pack"])
    (remark,) = stored.remarks
    assert remark == (
        "2 objects were not started everywhere: a/can_0 (no depth on it), b/can_0 (no depth on it)"
    )


def test_synthetic_data_is_said_to_be_so_wherever_it_lies_now(data):
    run = data.parent / "run"
    list(predict(make_standing, run_info(data), run))
    moved = data.rename(data.parent / "moved")
    (moved / "a" / "plan.json").write_text('{"mesh": null}')
    (stored,) = read_stored(run, PROTOCOLS["6pack"], moved)
    assert stored.data == "moved (recordings)"
    assert "procedural shapes" in stored.kind
    assert "not comparable" in stored.remarks[0]


def test_pose_noise_reaches_the_tracker_and_is_said(data):
    run = data.parent / "run"
    list(predict(make_standing, run_info(data, init_noise=2.0), run))
    (stored,) = read_stored(run, PROTOCOLS["captra"])
    first = stored.records[0]
    assert np.linalg.norm(first.T_cam_obj[:3, 3] - first.T_cam_obj_true[:3, 3]) > 1e-4
    assert "pose noise: Init×2, All×0" in stored.remarks


class Estimating(StandingTracker):
    """Starts anywhere, but never from a pose."""

    def start(self, frame, *, mask=None, box=None, T_cam_obj=None, extents=None):
        assert T_cam_obj is None
        assert mask is not None
        return super().start(frame, mask=mask, T_cam_obj=np.eye(4), extents=np.full(3, 0.1))


def test_single_views_are_estimated_from_masks_alone(data):
    run = data.parent / "run"
    made = []

    def make(category, cad, exact_start):
        made.append(Estimating(category))
        return made[-1]

    list(predict(make, run_info(data, single_view=True, every=2), run))
    assert {len(tracker.hints) for tracker in made} == {3}
    (stored,) = read_stored(run, PROTOCOLS["ycbv-auc"])
    assert len(stored.records) == 2 * 2 * 3
    assert any("not tracked" in remark for remark in stored.remarks)


def test_shards_share_the_sequences_out(data):
    run = data.parent / "run"
    assert list(predict(make_standing, run_info(data), run, shard=(1, 2))) == ["b"]
    assert list(predict(make_standing, run_info(data), run, shard=(0, 2))) == ["a"]


def test_meshes_come_from_folders_or_from_the_recordings_plan(data, tmp_path):
    sequence = open_with_truth(data).sequence("a")
    truth = replace(sequence.truth(0)[0], box_center=np.array([0.0, 0.5, 0.0]))
    with pytest.raises(InputError, match="no mesh of mug_0"):
        find_cad_mesh(sequence, truth, (tmp_path,))
    box = trimesh.creation.box((0.1, 0.2, 0.3))
    box.apply_translation([0.0, 0.5, 0.0])
    box.export(tmp_path / "mug.ply")
    mesh = find_cad_mesh(sequence, truth, (tmp_path / "none", tmp_path))
    np.testing.assert_allclose(mesh.vertices.max(axis=0), [0.05, 0.1, 0.15], atol=1e-6)
    plan = {"category": OBJECTS[0][1], "shape_seed": 7, "mesh": None}
    (data / "a" / "plan.json").write_text(json.dumps(plan))
    drawn = find_cad_mesh(FrameChoice(every=2).of(open_with_truth(data)).sequence("a"), truth, ())
    np.testing.assert_array_equal(drawn.vertices, make_object("mug", 7).mesh.vertices)


def test_a_recording_made_with_a_mesh_finds_it_where_it_was_taken_from(data, tmp_path):
    plan = {"category": "mug", "shape_seed": 7, "mesh": "blue.ply"}
    (data / "a" / "plan.json").write_text(json.dumps(plan))
    sequence = open_with_truth(data).sequence("a")
    truth = sequence.truth(0)[0]
    (tmp_path / "mug").mkdir()
    with pytest.raises(InputError, match="the one that its recording was made with"):
        find_cad_mesh(sequence, truth, (tmp_path,))
    box = trimesh.creation.box((0.1, 0.2, 0.3))
    box.apply_translation([0.0, 0.5, 0.0])
    box.export(tmp_path / "mug" / "blue.ply")
    mesh = find_cad_mesh(sequence, truth, (tmp_path,))
    np.testing.assert_allclose(mesh.vertices.max(axis=0), [0.05, 0.1, 0.15], atol=1e-6)
