"""robust6dof guide: its files, its resuming, its errors."""

import csv
import json
from pathlib import Path

import av
import pytest

from robust6dof.cli import main

OWN_ARM = Path(__file__).parents[1] / "robot" / "own_arm.urdf"
SHORT = ("--time-limit", "0.3", "--processes", "1", "--category", "can")
SUMMARY = {
    "seed", "reached", "time_s", "final_rotation_rad", "final_translation_m",
    "final_rotation_rad_estimated", "final_translation_m_estimated",
    "tracking_error_deg", "tracking_error_m",
}  # fmt: skip


def test_a_run_leaves_its_files_and_is_not_flown_twice(tmp_path, capsys):
    arguments = ["guide", "--seeds", "3", "--out", str(tmp_path), *SHORT]
    assert main(arguments) == 0
    said = capsys.readouterr().out
    assert "start hint: truth" in said
    folder = tmp_path / "seed_0003"
    summary = json.loads((folder / "summary.json").read_text())
    assert summary.keys() >= SUMMARY
    assert summary["seed"] == 3
    assert summary["reached"] is False
    assert summary["time_s"] is None
    campaign = json.loads((tmp_path / "campaign.json").read_text())
    assert campaign["runs"] == 1
    assert campaign["success_rate"] == 0.0
    assert campaign["median_time_s"] is None
    with (folder / "trace.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [float(row["time_s"]) for row in rows] == pytest.approx([0.05 * i for i in range(7)])
    for picture in ("velocities.png", "errors.png"):
        assert (folder / picture).read_bytes().startswith(b"\x89PNG")
    with av.open(str(folder / "guidance.mp4")) as video:
        frames = list(video.decode(video=0))
    assert (frames[0].width, frames[0].height) == (1280, 480)
    assert len(frames) == 4
    before = (folder / "trace.csv").stat().st_mtime_ns
    assert main(arguments) == 0
    assert "kept" in capsys.readouterr().out
    assert (folder / "trace.csv").stat().st_mtime_ns == before


def test_true_poses_need_no_tracker(tmp_path, capsys):
    arguments = ["guide", "--poses", "truth", "--no-video", "--out", str(tmp_path), *SHORT]
    assert main([*arguments, "--seed", "5"]) == 0
    assert "no tracker" in capsys.readouterr().out
    folder = tmp_path / "seed_0005"
    assert not (folder / "guidance.mp4").exists()
    assert json.loads((folder / "summary.json").read_text())["tracking_error_m"] < 1e-9


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("--scenario", "tabel"), "no scenario 'tabel'"),
        (("--seeds", "5..2"), "seeds must"),
        (("--standoff", "-1"), "stand-off"),
        (("--goal-tilt-deg", "80"), "tilt"),
        (("--goal", "missing.txt"), "missing.txt"),
        (("--tracker", "none"), "no tracker 'none'"),
        (("--category", "teapot"), "teapot"),
    ],
)
def test_mistakes_are_one_line(tmp_path: Path, capsys, arguments, says):
    assert main(["guide", "--out", str(tmp_path), *SHORT, *arguments]) == 1
    error = capsys.readouterr().err
    assert says in error
    assert len(error.splitlines()) == 1


def test_a_goal_that_no_level_vehicle_holds_is_refused(tmp_path: Path, capsys):
    from_below = tmp_path / "goal.txt"
    from_below.write_text("1 0 0 0  0 0 -1 0  0 1 0 0.5  0 0 0 1")
    arguments = ["guide", "--goal", str(from_below), "--out", str(tmp_path / "out"), *SHORT]
    assert main(arguments) == 1
    assert "out of the arm's reach" in capsys.readouterr().err


def test_ones_own_arm_flies(tmp_path: Path, capsys):
    """Turret, upper arm and forearm have no mass in the file, as is common."""
    arguments = ["guide", "--poses", "truth", "--no-video", "--no-plots", "--arm", str(OWN_ARM)]
    assert main([*arguments, "--seed", "3", "--out", str(tmp_path / "out"), *SHORT]) == 0
    settings = json.loads((tmp_path / "out" / "campaign.json").read_text())
    assert settings["arm"] == OWN_ARM.read_text()
    summary = json.loads((tmp_path / "out" / "seed_0003" / "summary.json").read_text())
    assert summary["limits_broken"] == []


def test_an_arm_of_three_joints_is_refused(tmp_path: Path, capsys):
    arm = tmp_path / "own.urdf"
    text = OWN_ARM.read_text()
    arm.write_text(
        text.replace('name="wrist_roll" type="revolute"', 'name="wrist_roll" type="fixed"')
    )
    arguments = ["guide", "--poses", "truth", "--arm", str(arm), "--out", str(tmp_path / "out")]
    assert main(arguments) == 1
    assert "3 joints" in capsys.readouterr().err
