"""What a campaign says of a run: broken limits, energy, steady errors, laws side by side."""

from dataclasses import replace

import numpy as np
import pytest

from robust6dof.cli import main
from robust6dof.robot.aerial_manipulator import default_aerial_manipulator
from robust6dof.servo.config import PadServoConfig
from robust6dof.servo.goal import look_down_goal
from robust6dof.simulation.episode import EpisodeOptions
from robust6dof.simulation.guidance import GuidanceConfig, run_guidance
from robust6dof.simulation.limits import broken_limits
from robust6dof.simulation.outcome import command_energy, judge_run
from robust6dof.simulation.pose_source import TruePoses
from robust6dof.simulation.scenario import scenario_named
from robust6dof.simulation.start import draw_episode
from robust6dof.simulation.trace import Trace

MANIPULATOR = default_aerial_manipulator()
GOAL = look_down_goal(0.5)
CONFIG = GuidanceConfig(time_limit=1.5)


@pytest.fixture(scope="module")
def run():
    episode = draw_episode(scenario_named("table"), EpisodeOptions("can"), MANIPULATOR, GOAL, 3)
    poses = TruePoses(episode.world.target.extents, latency=0.05)
    return run_guidance(episode, MANIPULATOR, GOAL, poses, CONFIG)


def _spoilt(trace: Trace, name: str, value: float) -> Trace:
    """The same trace with one signal different at one moment."""
    rows = list(trace.rows)
    rows[7] = rows[7] | {name: value}
    return Trace(tuple(rows))


def test_a_good_flight_breaks_no_limit(run):
    assert broken_limits(run.trace, CONFIG, MANIPULATOR.arm) == ()


@pytest.mark.parametrize(
    ("signal", "value", "limit"),
    [
        ("vx_cmd_m_s", -1.2, "speed"),
        ("wz_cmd_rad_s", 1.01, "yaw_rate"),
        ("joint3_rate_cmd_rad_s", -1.6, "joint_rate"),
        ("pitch_rad", 0.5, "tilt"),
        ("z_m", 0.2, "height"),
        ("z_m", 10.2, "height"),
        ("joint1_rad", 1.8, "joint_range"),
    ],
)
def test_each_broken_limit_is_named(run, signal, value, limit):
    assert broken_limits(_spoilt(run.trace, signal, value), CONFIG, MANIPULATOR.arm) == (limit,)


def test_coming_too_close_is_named(run):
    near = {"true_obj_x_m": 0.0, "true_obj_y_m": 0.0, "true_obj_z_m": 0.15}
    trace = Trace(tuple(row | near for row in run.trace.rows))
    assert broken_limits(trace, CONFIG, MANIPULATOR.arm) == ("distance",)


def test_energy_is_the_integral_of_the_squared_commands(run):
    linear, angular = command_energy(run.trace, 0.05)
    expected_linear, expected_angular = 0.0, 0.0
    for row in run.trace.rows:
        expected_linear += 0.05 * sum(float(row[f"v{axis}_cmd_m_s"]) ** 2 for axis in "xyz")
        expected_angular += 0.05 * float(row["wz_cmd_rad_s"]) ** 2
        for i in range(1, 5):
            expected_angular += 0.05 * float(row[f"joint{i}_rate_cmd_rad_s"]) ** 2
    assert (linear, angular) == pytest.approx((expected_linear, expected_angular))
    assert linear > 0
    assert angular > 0


def test_steady_errors_are_split_into_tracking_and_control(run):
    outcome = judge_run(3, "can", run, CONFIG, MANIPULATOR.arm)
    assert outcome.steady_tracking_m == 0.0  # the poses are true
    late = run.trace.column("estimated_translation_error_m")[run.trace.column("time_s") > 0.5]
    assert outcome.steady_control_m == pytest.approx(np.median(late))


def test_laws_are_compared_from_the_same_starts(tmp_path, capsys):
    arguments = ["guide", "--poses", "truth", "--law", "coupled,printed", "--time-limit", "0.2",
                 "--category", "can", "--no-video", "--no-plots", "--processes", "1",
                 "--out", str(tmp_path)]  # fmt: skip
    assert main(arguments) == 0
    table = (tmp_path / "laws.md").read_text()
    assert table in capsys.readouterr().out
    rows = [line.split(" | ")[0].lstrip("| ") for line in table.splitlines()[2:]]
    assert rows == ["coupled", "printed"]
    starts = [
        Trace.read(tmp_path / law / "seed_0000" / "trace.csv").rows[0]["true_obj_x_m"]
        for law in rows
    ]
    assert starts[0] == starts[1]


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("--law", "coupled,fastest"), "no law 'fastest'"),
        (("--speed", "3"), "--speed"),
        (("--path", "circle"), "for --scenario moving"),
    ],
)
def test_what_no_run_could_use_is_refused(tmp_path, capsys, arguments, says):
    assert main(["guide", "--out", str(tmp_path), *arguments]) == 1
    assert says in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize("path", ["straight", "circle", "stop-and-go"])
def test_a_moving_target_is_followed_within_four_centimetres(path):
    scenario = replace(scenario_named("moving"), motion=path, speed=(0.3, 0.3))
    episode = draw_episode(scenario, EpisodeOptions(), MANIPULATOR, GOAL, 0)
    config = GuidanceConfig(PadServoConfig(law="feedforward"), time_limit=34.0)
    poses = TruePoses(episode.world.target.extents, latency=0.05)
    outcome = judge_run(
        0, "any", run_guidance(episode, MANIPULATOR, GOAL, poses, config), config, MANIPULATOR.arm
    )
    assert outcome.lag_m is not None
    assert outcome.lag_m < 0.04
    assert outcome.limits_broken == ()


@pytest.mark.slow
def test_gusts_break_no_limit():
    episode = draw_episode(scenario_named("gust"), EpisodeOptions(), MANIPULATOR, GOAL, 0)
    poses = TruePoses(episode.world.target.extents, latency=0.05)
    config = GuidanceConfig(time_limit=25.0)
    run = run_guidance(episode, MANIPULATOR, GOAL, poses, config)
    assert broken_limits(run.trace, config, MANIPULATOR.arm) == ()
