"""`robust6dof evaluate` from the command line, on stored poses of both kinds."""

import json
import subprocess
import sys
import zipfile

import numpy as np
import pytest

from evaluation.small_recordings import make_standing, write_recording
from robust6dof.cli import main
from robust6dof.evaluation.predict import predict
from robust6dof.evaluation.run_info import RunInfo
from shared_data import shared_data


@pytest.fixture
def run(tmp_path):
    write_recording(tmp_path / "data" / "a")
    write_recording(tmp_path / "data" / "b")
    info = RunInfo("standing", "aerial", str(tmp_path / "data"), 0)
    list(predict(make_standing, info, tmp_path / "run"))
    return tmp_path / "run"


def test_a_run_is_scored_on_the_data_it_was_made_on(run, tmp_path, capsys):
    out = tmp_path / "out"
    assert main(["evaluate", str(run), "--protocol", "aerial", "--out", str(out)]) == 0
    fields = json.loads((out / "scores.json").read_text())
    assert (fields["protocol"], fields["iou"], fields["tracker"]) == (
        "aerial",
        "obb_exact",
        "standing",
    )
    assert fields["details"]["frames"] == 2 * 2 * 4
    assert fields["per_category"].keys() == {"can", "mug"}
    assert fields["details"]["interval95"]["5deg5cm"][0] is not None
    assert "| **standing** |" in capsys.readouterr().out
    assert (out / "table.md").is_file()
    assert (out / "curves.png").is_file()


def test_another_protocol_says_how_the_run_was_started(run, tmp_path):
    out = tmp_path / "out"
    assert main(["evaluate", str(run), "--protocol", "captra", "--out", str(out)]) == 0
    fields = json.loads((out / "scores.json").read_text())
    assert fields["tracker"] == "standing (started as aerial)"


def test_exported_poses_score_as_the_run(run, tmp_path):
    args = ["--protocol", "6pack", "--out"]
    assert main(["evaluate", str(run), *args, str(tmp_path / "x"), "--export", "6pack"]) == 0
    (export,) = (tmp_path / "x" / "export").iterdir()
    data = ["--data", str(tmp_path / "data")]
    assert main(["evaluate", str(export), *args, str(tmp_path / "y"), *data]) == 0
    first, second = (json.loads((tmp_path / n / "scores.json").read_text()) for n in "xy")
    assert first["mean"] == pytest.approx(second["mean"], rel=1e-5)


def test_a_pose_pack_finds_the_models_beside_it(tmp_path):
    pack = tmp_path / "poses.zip"
    with zipfile.ZipFile(pack, "w") as file:
        file.writestr("poses/ground_truth/0048_025_mug.txt", "1 0 0 0 0 0 1\n" * 3)
        file.writestr("poses/mine/0048_025_mug.txt", "1 0 0 0 0 0 1\n" * 2 + "0 0 0 0 0 0 0\n")
    models = tmp_path / "models_points"
    models.mkdir()
    np.savetxt(models / "025_mug.xyz", np.random.default_rng(0).uniform(-0.05, 0.05, (20, 3)))
    out = tmp_path / "out"
    args = ["evaluate", str(pack), "--protocol", "ycbv-auc", "--out", str(out)]
    assert main([*args, "--method", "mine"]) == 0
    fields = json.loads((out / "scores.json").read_text())
    assert fields["mean"]["ADD_auc"] == pytest.approx(200 / 3)
    assert fields["details"]["point_stride"] == 3
    assert fields["details"]["every_point"]["ADD_auc"] == pytest.approx(200 / 3)
    assert fields["tracker"] == "mine"
    assert fields["iou"] is None


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_posecnn_comes_out_as_published(tmp_path):
    """Its paper prints 53.7 / 75.9; with every third model point it is 53.7 / 75.2."""
    pack = shared_data("ycb_video_poses") / "icg_poses_ycb-video.zip"
    args = ["evaluate", str(pack), "--method", "posecnn_rss2018", "--protocol", "ycbv-auc"]
    assert main([*args, "--out", str(tmp_path)]) == 0
    fields = json.loads((tmp_path / "scores.json").read_text())
    assert fields["details"]["pairs"] == 14_025
    assert fields["mean"]["ADD_auc"] == pytest.approx(53.7, abs=0.1)
    assert fields["mean"]["ADDS_auc"] == pytest.approx(75.2, abs=0.1)
    all_points = fields["details"]["every_point"]
    assert all_points["ADD_auc"] == pytest.approx(53.7, abs=0.1)
    assert all_points["ADDS_auc"] == pytest.approx(75.9, abs=0.15)


def test_mistakes_are_told_in_one_line(tmp_path, capsys):
    args = ["--protocol", "aerial", "--out", str(tmp_path / "out")]
    assert main(["evaluate", str(tmp_path / "nowhere"), *args]) == 1
    assert capsys.readouterr().err.endswith("does not exist\n")


def robust6dof(*args):
    """The command in a process of its own, as users start it."""
    command = [sys.executable, "-m", "robust6dof", *map(str, args)]
    return subprocess.run(command, capture_output=True, text=True, check=False)


def test_predict_stores_a_run_that_evaluate_scores(tmp_path):
    write_recording(tmp_path / "data" / "a")
    common = ["--protocol", "aerial", "--out"]
    predicted = robust6dof(
        "predict", tmp_path / "data", *common, tmp_path / "run", "--tracker", "static"
    )
    assert predicted.returncode == 0, predicted.stderr
    assert "a: done" in predicted.stdout
    scored = robust6dof("evaluate", tmp_path / "run", *common, tmp_path / "out")
    assert scored.returncode == 0, scored.stderr
    fields = json.loads((tmp_path / "out" / "scores.json").read_text())
    # The objects move 1 cm a frame and the tracker stands: noise and at most 4 cm.
    assert 0 < fields["mean"]["T_err_cm"] < 15


def test_an_unknown_tracker_lists_what_there_is(tmp_path):
    write_recording(tmp_path / "a", frames=2)
    args = ["--protocol", "aerial", "--out", tmp_path / "run", "--tracker", "nothing"]
    result = robust6dof("predict", tmp_path / "a", *args)
    assert result.returncode == 1
    assert "no tracker 'nothing'; there is: robust6dof, " in result.stderr
