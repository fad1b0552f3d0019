"""robust6dof guide: its files, its resuming, its errors."""

import csv
import json
from pathlib import Path

import av
import pytest

from robust6dof.cli import main

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


ARM_OF_FOUR = """<robot name="own">
  <link name="base"><inertial><mass value="0.1"/><inertia ixx="5e-5" iyy="5e-5" izz="5e-5"
    ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="turret"/><link name="upper"/><link name="fore"/><link name="wrist"/>
  <link name="camera_optical_frame"><inertial><mass value="0.07"/>
    <inertia ixx="2e-5" iyy="2e-5" izz="2e-5" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="yaw" type="revolute"><parent link="base"/><child link="turret"/>
    <axis xyz="0 0 1"/><limit lower="-1.6" upper="1.6" velocity="2.5" effort="4"/></joint>
  <joint name="shoulder" type="revolute"><parent link="turret"/><child link="upper"/>
    <origin xyz="0 0 -0.06"/><axis xyz="0 1 0"/>
    <limit lower="-0.6" upper="0.6" velocity="2.5" effort="4"/></joint>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="fore"/>
    <origin xyz="0 0 -0.12"/><axis xyz="0 1 0"/>
    <limit lower="-0.8" upper="0.8" velocity="2.5" effort="4"/></joint>
  <joint name="roll" type="revolute"><parent link="fore"/><child link="wrist"/>
    <origin xyz="0.1 0 -0.02"/><axis xyz="1 0 0"/>
    <limit lower="-1.2" upper="1.2" velocity="2.5" effort="4"/></joint>
  <joint name="optics" type="fixed"><parent link="wrist"/><child link="camera_optical_frame"/>
    <origin xyz="0.05 0 0" rpy="3.141592653589793 0 -1.5707963267948966"/></joint>
</robot>"""


def test_ones_own_arm_flies(tmp_path: Path, capsys):
    """The turret, upper arm and wrist have no mass in the file, as is common."""
    arm = tmp_path / "own.urdf"
    arm.write_text(ARM_OF_FOUR)
    arguments = ["guide", "--poses", "truth", "--no-video", "--no-plots", "--arm", str(arm)]
    assert main([*arguments, "--seed", "3", "--out", str(tmp_path / "out"), *SHORT]) == 0
    settings = json.loads((tmp_path / "out" / "campaign.json").read_text())
    assert settings["arm"] == ARM_OF_FOUR
    summary = json.loads((tmp_path / "out" / "seed_0003" / "summary.json").read_text())
    assert summary["limits_broken"] == []


def test_an_arm_of_three_joints_is_refused(tmp_path: Path, capsys):
    arm = tmp_path / "own.urdf"
    arm.write_text(ARM_OF_FOUR.replace('name="roll" type="revolute"', 'name="roll" type="fixed"'))
    arguments = ["guide", "--poses", "truth", "--arm", str(arm), "--out", str(tmp_path / "out")]
    assert main(arguments) == 1
    assert "3 joints" in capsys.readouterr().err
