"""Experiments: the same figures as predict and evaluate give, laid out as in the paper."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from evaluation.small_recordings import write_recording
from robust6dof.cli import main
from robust6dof.errors import InputError
from robust6dof.evaluation.data_kind import data_kind
from robust6dof.evaluation.evaluate import read_stored, score_stored
from robust6dof.evaluation.protocols import find_protocol
from robust6dof.experiments.ablations import _with_keypoints
from robust6dof.experiments.budget import budget_recipe
from robust6dof.experiments.registry import EXPERIMENTS, find_experiment
from robust6dof.experiments.report import Line, Report, markdown, write
from robust6dof.experiments.setting import Setting, Size
from robust6dof.network.checkpoint import load_network, save_network
from robust6dof.network.config import preset
from robust6dof.network.robust6dof_net import Robust6DofNet


@pytest.fixture
def setting(tmp_path):
    for name in ("a", "b", "c"):
        write_recording(tmp_path / "data" / name, frames=12)
    size = Size(2, 12, 3, "tiny", 1)
    return Setting(tmp_path / "out" / "one", tmp_path / "data", "static", (), size)


def test_every_table_and_figure_of_the_paper_has_a_name():
    assert set(EXPERIMENTS) == {
        "estimation",
        "tracking",
        "ycb-video",
        "ycbineoat",
        "wild6d",
        "speed",
        "dropped-frames",
        "pose-noise",
        "keypoint-count",
        "component-ablation",
        "keypoint-ablation",
        "loss-ablation",
        "qualitative",
        "losses",
        "calibration",
        "drift",
    }
    with pytest.raises(InputError, match="no experiment 'magic'; there is: estimation"):
        find_experiment("magic")


def test_tracking_prints_what_evaluate_says_of_the_same_run(setting):
    report = find_experiment("tracking").run(setting)
    run = setting.out.parent / "runs" / "data" / "static-6pack"
    (stored,) = read_stored(run, find_protocol("6pack"))
    used = [record for record in stored.records if record.sequence in ("a", "b")]
    scores = score_stored(stored.__class__("x", "y", used), find_protocol("6pack"))
    assert report.lines[0].values == pytest.approx(scores.mean, nan_ok=True)
    assert report.lines[0].interval.keys() == scores.details["interval95"].keys()
    assert not (run / "c").exists()
    assert {"static: can", "static: mug", "BundleTrack"} <= {line.name for line in report.lines}
    assert all(path.is_file() for path in report.figures)


def test_the_command_takes_up_its_runs_at_the_frames_that_were_asked_for(tmp_path, capsys):
    write_recording(tmp_path / "data" / "a", frames=8)
    args = ["experiment", "tracking", str(tmp_path / "data"), "--out", str(tmp_path / "out")]
    few = [*args, "--tracker", "static", "--baselines", "--frames", "5"]
    assert main(few) == 0
    assert "| static |" in capsys.readouterr().out
    run = tmp_path / "out" / "runs" / "data" / "static-6pack"
    assert json.loads((run / "a" / "done.json").read_text())["frames"] == 5
    assert main(few) == 0
    assert "static-6pack: a" not in capsys.readouterr().out
    assert main([*few[:-1], "6"]) == 1  # that run has other frames
    assert "holds another run" in capsys.readouterr().err


def test_dropped_frames_make_a_standing_tracker_worse_the_more_there_are(setting):
    report = find_experiment("dropped-frames").run(setting)
    errors = [line.values["T_err_cm"] for line in report.lines]
    assert [line.name for line in report.lines] == ["static, N = 0", "static, N = 5"]
    # The objects move 1 cm a frame: frames 1 to 11 and 6 to 11 behind the noise of the start.
    assert errors[1] - errors[0] == pytest.approx(2.5, abs=1.0)
    assert "too short for N = 10, 25, 50, 75, 100" in report.notes[-1]


def test_noise_reaches_the_first_pose_or_every_one(setting):
    report = find_experiment("pose-noise").run(setting)
    (figure,) = report.figures
    assert figure.stat().st_size > 5000
    found = {line.name: line.values["5deg5cm"] for line in report.lines}
    assert len({found[f"static, {name}"] for name in ("Orig.", "Init ×2", "All ×2")}) == 3
    assert found["static, All ×2"] < found["static, Orig."]  # it stands where noise carries it
    assert found["Robust6DoF (paper), All ×2"] == 68.5


def test_speed_is_that_of_the_stored_steps(setting):
    report = find_experiment("speed").run(setting)
    runs = setting.out.parent / "runs" / "data"
    lines = (runs / "static-aerial" / "a" / "can_0" / "track.jsonl").read_text()
    ms = [json.loads(line)["ms"] for line in lines.splitlines()]
    assert 1000 / max(ms) < report.lines[0].values["FPS"] < 1e6
    assert report.lines[-1].values == {"FPS": 24.2}


def test_pictures_have_a_row_for_each_tracker_and_a_column_for_each_moment(setting):
    from robust6dof.data.image_files import image_size

    report = find_experiment("qualitative").run(setting)
    assert [path.name for path in report.figures] == ["a.png", "b.png"]
    assert image_size(report.figures[0]) == (5 * 320, 240)


def test_the_number_of_keypoints_changes_and_the_weights_stay(tmp_path):
    net = Robust6DofNet(preset("tiny"))
    weights = save_network(net, tmp_path / "net")
    other = load_network(_with_keypoints(weights, 100, tmp_path / "n100"))
    assert (other.config.keypoints, other.config.prior_points) == (100, 100)
    for name, value in net.state_dict().items():
        np.testing.assert_array_equal(value.numpy(), other.state_dict()[name].numpy())


def test_experiments_share_their_runs(setting):
    find_experiment("tracking").run(setting)
    done = setting.out.parent / "runs" / "data" / "static-6pack" / "a" / "done.json"
    written = done.stat().st_mtime_ns
    find_experiment("pose-noise").run(replace(setting, out=setting.out.parent / "two"))
    assert done.stat().st_mtime_ns == written


def test_pooling_a_run_with_itself_changes_nothing(setting):
    """Neither the figures nor how sure they are: the sequences are the same."""
    run = setting.predict("static", "6pack")
    once, twice = setting.scores(run, "6pack"), setting.pooled_scores([run, run], "6pack")
    assert twice.mean == pytest.approx(once.mean, nan_ok=True)
    for key, ends in once.details["interval95"].items():
        assert twice.details["interval95"][key] == pytest.approx(ends)


@pytest.mark.parametrize("steps", [2, 100, 300, 100_000])
def test_a_short_training_forgets_its_first_weights(steps):
    recipe = budget_recipe(steps)
    assert recipe.steps == steps
    assert recipe.ema**steps < 1e-8
    assert recipe.ema <= 0.998


def test_tables_say_what_is_undefined_and_how_sure_the_rest_is(tmp_path):
    lines = (
        Line("ours", {"5deg5cm": 50.0, "R_err_deg": float("nan")}, {"5deg5cm": (40.0, 61.0)}),
        Line("paper", {"5deg5cm": 70.6}, remark="published"),
    )
    report = Report("Title", "nothing", ("5deg5cm", "R_err_deg"), lines)
    text = markdown(report, tmp_path)
    assert "| ours | 50.0 [40.0, 61.0] | – |  |" in text
    assert "| paper | 70.6 | – | published |" in text
    write(report, tmp_path)
    found = json.loads((tmp_path / "results.json").read_text())
    assert found["rows"][0]["values"] == {"5deg5cm": 50.0, "R_err_deg": None}


def test_the_kind_of_data_is_told(tmp_path):
    assert data_kind(tmp_path) == "recorded images"
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "plan.json").write_text('{"shape_seed": 1, "mesh": null}')
    assert "procedural shapes" in data_kind(tmp_path)
    (tmp_path / "a" / "plan.json").write_text('{"video": "0048"}')
    assert "real trajectories, scanned shapes" in data_kind(tmp_path)


@pytest.mark.slow
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("name", ["estimation", "ycb-video", "loss-ablation"])
def test_experiments_make_their_own_data(tmp_path, name):
    size = Size(1, 4, 2, "tiny", 1)
    setting = Setting(tmp_path / name, None, "icp", (), size, device="cpu", steps=1)
    report = find_experiment(name).run(setting)
    write(report, setting.out)
    assert "AerialPose-Sim" in (setting.out / "table.md").read_text()
    assert all(path.is_file() for path in report.figures)
