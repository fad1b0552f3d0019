"""Poses survive each foreign format, and a stored set scores as the records it came from."""

import pickle

import numpy as np
import pytest

from evaluation.pose_records import EXTENTS, TRUE_POSE, record
from evaluation.small_recordings import true_pose, write_recording
from robust6dof.data.truth_file import open_with_truth
from robust6dof.errors import DataError, InputError
from robust6dof.evaluation.detections import images_from_records
from robust6dof.evaluation.evaluate import read_stored, recognise_format, score_stored
from robust6dof.evaluation.protocols import PROTOCOLS, nocs_map
from robust6dof.evaluation.records import PoseRecord
from robust6dof.evaluation.result_formats import (
    BopCsv,
    export_records,
    read_nocs_results,
    write_nocs_results,
)
from robust6dof.evaluation.run_records import make_records


@pytest.fixture
def data(tmp_path):
    write_recording(tmp_path / "data" / "scene_1", frames=4)
    write_recording(tmp_path / "data" / "scene_2", frames=2)
    return tmp_path / "data"


def shifted(data):
    """Records of every truth with a prediction 2 cm aside, one of them missing."""
    dataset = open_with_truth(data, with_masks=False)
    records = []
    for r in make_records(dataset, lambda *_: None):
        T = r.T_cam_obj_true.copy()
        T[0, 3] += 0.02
        missing = (r.sequence, r.frame, r.object) == ("scene_1", 2, "can_0")
        fields = {**vars(r), "T_cam_obj": None if missing else T, "extents": r.extents_true}
        records.append(PoseRecord(**{**fields, "confidence": 0.8}))
    return records


@pytest.mark.parametrize("form", ["6pack", "ob_in_cam", "bop"])
def test_what_is_exported_reads_back(form, data, tmp_path):
    records = shifted(data)
    export_records(form, tmp_path / "export", records)
    path = tmp_path / "export"
    path = path / "results.csv" if form == "bop" else path
    assert recognise_format(path) == form
    (stored,) = read_stored(path, PROTOCOLS["6pack"], data)
    assert len(stored.records) == len(records)
    for read, written in zip(stored.records, records, strict=True):
        if written.T_cam_obj is None:
            assert read.T_cam_obj is None
        else:
            np.testing.assert_allclose(read.T_cam_obj, written.T_cam_obj, atol=1e-7)
    direct = PROTOCOLS["6pack"].score(records)
    scores = score_stored(stored, PROTOCOLS["6pack"])
    assert scores.mean == pytest.approx(direct.mean)
    assert scores.data == "data (recordings)"


def test_six_pack_flips_the_camera_and_writes_millimetres(data, tmp_path):
    export_records("6pack", tmp_path / "export", shifted(data))
    rows = np.loadtxt(tmp_path / "export" / "temp_6" / "mug_0_scene_2_5_pose.txt")
    T = true_pose(1, "mug_0")  # the sixth frame of this model: scene_1 has four
    np.testing.assert_allclose(rows[3], [-1000 * (T[0, 3] + 0.02), 0, 800], atol=1e-6)
    np.testing.assert_allclose(rows[:3], np.diag([-1, -1, 1]) @ T[:3, :3], atol=1e-8)


def test_nocs_results_read_back_and_score_the_same(data, tmp_path):
    records = shifted(data)
    write_nocs_results(tmp_path / "nocs", records)
    images = read_nocs_results(tmp_path / "nocs")
    assert len(images) == 6
    assert len(images[2].predicted.category) == 1
    for image, made in zip(images, images_from_records(records), strict=True):
        np.testing.assert_allclose(image.true.extents, made.true.extents)
        np.testing.assert_allclose(image.predicted.T_cam_obj, made.predicted.T_cam_obj)
    (stored,) = read_stored(tmp_path / "nocs", PROTOCOLS["nocs-map"])
    assert score_stored(stored, PROTOCOLS["nocs-map"]).mean == pytest.approx(
        nocs_map.score(records).mean
    )
    with pytest.raises(InputError, match="only by nocs-map"):
        score_stored(stored, PROTOCOLS["aerial"])


def nocs_fields(**changes):
    scale = np.linalg.norm(EXTENTS)
    RT = TRUE_POSE.copy()
    RT[:3, :3] *= scale
    side = {"class_ids": [3], "RTs": RT[None], "scales": (EXTENTS / scale)[None]}
    fields = {f"{end}_{key}": value for end in ("gt", "pred") for key, value in side.items()}
    return {**fields, "pred_scores": [0.9], **changes}


def store(folder, fields):
    (folder / "results_real_test_scene_1_0000.pkl").write_bytes(pickle.dumps(fields))
    return folder


def test_nocs_results_without_visibility_count_every_handle_as_visible(tmp_path):
    (image,) = read_nocs_results(store(tmp_path, nocs_fields()))
    assert image.true.handle_visible.tolist() == [True]
    np.testing.assert_allclose(image.true.extents[0], EXTENTS)
    np.testing.assert_allclose(image.predicted.T_cam_obj[0], TRUE_POSE)


@pytest.mark.parametrize("broken", [np.zeros((1, 4, 4)), np.full((1, 4, 4), np.nan)])
@pytest.mark.parametrize("protocol", ["nocs-map", "wild6d"])
def test_a_failed_fit_stays_a_false_positive(tmp_path, broken, protocol):
    store(tmp_path, nocs_fields(pred_RTs=broken))
    (stored,) = read_stored(tmp_path, PROTOCOLS[protocol])
    row = score_stored(stored, PROTOCOLS[protocol]).mean
    assert row["IoU25"] == 0


def test_nocs_results_that_are_incomplete_or_foreign_are_refused(tmp_path):
    with pytest.raises(DataError, match="no results_"):
        read_nocs_results(tmp_path)
    fields = nocs_fields()
    del fields["pred_scores"]
    with pytest.raises(DataError, match="not a NOCS result"):
        read_nocs_results(store(tmp_path, fields))
    with pytest.raises(DataError, match="refused"):
        read_nocs_results(store(tmp_path, {"x": np.polynomial.Polynomial([1, 2])}))


def test_bop_csv_takes_the_best_of_several_and_refuses_nonsense(tmp_path):
    path = tmp_path / "results.csv"
    line = "1,2,6,{},1 0 0 0 1 0 0 0 1,{} 0 800,-1\n"
    path.write_text(
        "scene_id,im_id,obj_id,score,R,t,time\n" + line.format(0.3, 10) + line.format(0.7, 20)
    )
    assert BopCsv(path)._best[1, 2, 6][1][0, 3] == pytest.approx(0.02)
    path.write_text(line.format(0.3, 10).replace("1 0 0 0 1 0 0 0 1", "2 0 0 0 1 0 0 0 1"))
    with pytest.raises(DataError, match="line 1 is no BOP result"):
        BopCsv(path)


def test_bop_poses_are_those_of_the_box(tmp_path):
    """BOP centres its models; ours lie where their data set puts them."""
    center = np.array([0.01, 0.02, 0.03])
    r = record(0, category="025_mug", sequence="0048", frame_name="000001", box_center=center)
    export_records("bop", tmp_path, [r])
    T_cam_box = BopCsv(tmp_path / "results.csv")._best[48, 1, 14][1]
    np.testing.assert_allclose(
        T_cam_box[:3, 3], TRUE_POSE[:3, 3] + TRUE_POSE[:3, :3] @ center, atol=1e-6
    )


def test_poses_without_truth_need_data(tmp_path):
    (tmp_path / "x.txt").write_text("")
    with pytest.raises(InputError, match="give --data"):
        read_stored(tmp_path, PROTOCOLS["aerial"])
    with pytest.raises(InputError, match="does not exist"):
        read_stored(tmp_path / "nowhere", PROTOCOLS["aerial"])


def test_a_folder_that_fits_no_frame_is_refused(data, tmp_path):
    (tmp_path / "empty").mkdir()
    with pytest.raises(InputError, match="holds no pose"):
        read_stored(tmp_path / "empty", PROTOCOLS["aerial"], data)
