"""The closed loop: it converges, repeats, and shows the tracker nothing but images."""

from dataclasses import fields, replace

import numpy as np
import pytest

from robust6dof.frames import RgbdFrame, Track, TrackState
from robust6dof.rendering.sensor import StereoSensorConfig
from robust6dof.robot.aerial_manipulator import default_aerial_manipulator
from robust6dof.servo.config import PadServoConfig
from robust6dof.servo.goal import look_down_goal
from robust6dof.simulation.episode import EpisodeOptions
from robust6dof.simulation.eye_in_hand import Exposure
from robust6dof.simulation.guidance import GuidanceConfig, run_guidance
from robust6dof.simulation.judge import Arrival, GoalError, goal_error, tracking_error
from robust6dof.simulation.outcome import judge_run, sum_up
from robust6dof.simulation.pose_source import TrackedPoses, TruePoses
from robust6dof.simulation.scenario import scenario_named
from robust6dof.simulation.start import draw_episode
from robust6dof.tracking.surface.icp import IcpTracker

MANIPULATOR = default_aerial_manipulator()
GOAL = look_down_goal(0.5)
LATENCY = 0.05


@pytest.fixture(scope="module")
def episode():
    return draw_episode(scenario_named("table"), EpisodeOptions("mug"), MANIPULATOR, GOAL, 0)


def fly(episode, poses, time_limit=1.0):
    return run_guidance(episode, MANIPULATOR, GOAL, poses, GuidanceConfig(time_limit=time_limit))


class FrozenTracker:
    """Always says the same, and keeps what it was shown."""

    def __init__(self):
        self.started_with = {}
        self.seen = []

    def start(self, frame, *, mask=None, box=None, T_cam_obj=None, extents=None):
        self.started_with = {"mask": mask, "T_cam_obj": T_cam_obj}
        return Track(T_cam_obj, extents, 1.0, TrackState.TRACKING, "mug", stamp=frame.stamp)

    def step(self, track, frame):
        self.seen.append((track, frame))
        return replace(track, stamp=frame.stamp)


def test_both_errors_shrink_with_true_poses(episode):
    config = GuidanceConfig(time_limit=3.0)
    poses = TruePoses(episode.world.target.extents, LATENCY)
    run = run_guidance(episode, MANIPULATOR, GOAL, poses, config)
    for name in ("true_translation_error_m", "true_rotation_error_rad"):
        errors = run.trace.column(name)
        assert errors[-1] < 0.7 * errors[0]
    assert len(run.trace) == 61
    np.testing.assert_allclose(np.diff(run.trace.column("time_s")), 0.05, atol=1e-9)
    assert np.abs(run.trace.column("pitch_rad")).max() > 1e-3
    assert not run.touched


def test_after_the_first_frame_a_tracker_gets_images_only(episode):
    tracker = FrozenTracker()
    fly(episode, TrackedPoses(tracker, episode.world.target.extents, LATENCY), 0.5)
    assert tracker.started_with["mask"].sum() > 200
    assert len(tracker.seen) == 10
    T_start = tracker.started_with["T_cam_obj"]
    for track, frame in tracker.seen:
        assert type(frame) is RgbdFrame
        assert frame.R_ref_cam is None
        assert (track.T_cam_obj == T_start).all()  # its own track comes back to it, nothing else
    assert {field.name for field in fields(RgbdFrame)} == {
        "rgb", "depth", "K", "stamp", "name", "has_color", "R_ref_cam"
    }  # fmt: skip


def test_the_servo_sees_only_what_the_source_says(episode):
    """Were the truth to leak, a tracker stuck at the start pose could not keep the errors up."""
    poses = TrackedPoses(FrozenTracker(), episode.world.target.extents, LATENCY)
    trace = fly(episode, poses, 1.5).trace
    estimated = trace.column("estimated_translation_error_m")[2:]
    np.testing.assert_allclose(estimated, estimated[0], atol=1e-9)
    assert (trace.column("tracking_error_m")[-1]) > 0.02


def test_a_pose_comes_as_late_as_its_image(episode):
    trace = fly(episode, TruePoses(episode.world.target.extents, 0.1), 0.5).trace
    ages = trace.column("image_age_s")
    assert np.isnan(ages[:2]).all()
    np.testing.assert_allclose(ages[2:], 0.1, atol=1e-9)


def test_images_that_arrive_while_a_slow_tracker_computes_are_skipped():
    poses = TrackedPoses(FrozenTracker(), np.ones(3), LATENCY, measured=True)
    frame = RgbdFrame(
        np.zeros((4, 4, 3), np.uint8),
        np.ones((4, 4), np.float32),
        np.array([[4.0, 0, 1.5], [0, 4.0, 1.5], [0, 0, 1]]),
    )
    exposure = Exposure(frame, np.ones((4, 4), bool))
    first = poses.estimate(0.0, exposure, np.eye(4))
    assert first is not None
    assert first.due > LATENCY
    assert not poses.needs_image(first.due - LATENCY - 1e-6)
    assert poses.estimate(first.due - LATENCY - 1e-6, exposure, np.eye(4)) is None
    assert poses.needs_image(first.due - LATENCY + 1e-6)


def test_a_run_repeats_exactly(episode):
    extents = episode.world.target.extents
    runs = [fly(episode, TrackedPoses(IcpTracker("mug"), extents, LATENCY), 0.3) for _ in "ab"]
    for a, b in zip(runs[0].trace.rows, runs[1].trace.rows, strict=True):
        signals = set(a) - {"tracker_ms"}
        assert {key: str(a[key]) for key in signals} == {key: str(b[key]) for key in signals}


def test_the_icp_tracks_in_the_loop(episode):
    extents = episode.world.target.extents
    trace = fly(episode, TrackedPoses(IcpTracker("mug"), extents, LATENCY), 1.0).trace
    assert np.nanmax(trace.column("tracking_error_m")) < 0.02


def test_arrival_needs_both_errors_and_a_stay():
    config = PadServoConfig()
    near, off = np.array([0.03, 0, 0]), np.array([0.2, 0, 0])
    arrival = Arrival(config, hold=0.1)
    for now, error in ((0.0, GoalError(near, off)), (0.05, GoalError(near, near))):
        arrival = arrival.seen(now, error)
    assert arrival.since == 0.05
    assert arrival.first is None
    lost = arrival.seen(0.1, GoalError(off, near))
    assert lost.since is None
    slack = arrival.seen(0.1, GoalError(np.array([0.05, 0, 0]), near))  # within the hysteresis
    held = slack.seen(0.15, GoalError(near, near))
    assert held.is_held
    assert held.first == 0.05


def test_errors_ignore_a_symmetric_objects_turn():
    turned = GOAL.copy()
    c, s = np.cos(1.0), np.sin(1.0)
    turned[:3, :3] = GOAL[:3, :3] @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    assert goal_error(turned, GOAL, True).angle < 1e-7
    assert abs(goal_error(turned, GOAL, False).angle - 1.0) < 1e-9
    assert tracking_error(turned, GOAL, True)[0] < 1e-7
    assert np.isnan(goal_error(None, GOAL, False).angle)


@pytest.mark.slow
@pytest.mark.parametrize("category", ["mug", "bottle"])
def test_the_goal_is_reached_with_true_poses(category):
    options = EpisodeOptions(category)
    episode = draw_episode(scenario_named("table"), options, MANIPULATOR, GOAL, 7)
    config = GuidanceConfig(sensor=StereoSensorConfig.perfect())
    poses = TruePoses(episode.world.target.extents, LATENCY)
    run = run_guidance(episode, MANIPULATOR, GOAL, poses, config)
    outcome = judge_run(7, category, run, config, MANIPULATOR.arm)
    assert outcome.reached
    assert outcome.reached_estimated
    assert outcome.time_ratio is not None
    assert outcome.time_ratio < 1.5
    assert sum_up([outcome])["success_rate"] == 1.0
