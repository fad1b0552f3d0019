"""Saturation, limits one by one, and goals."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from robust6dof.errors import DataError, InputError
from robust6dof.robot.aerial_manipulator import default_aerial_manipulator
from robust6dof.robot.reachability import reach_goal
from robust6dof.servo.goal import look_down_goal, read_goal
from robust6dof.servo.safety import (
    SafetyLimits,
    keep_clear,
    limit_acceleration,
    saturate,
    smooth_scale,
)

LIMITS = SafetyLimits()
RATES = np.full(4, 2.5)


def test_smooth_scale_is_one_then_nears_the_limit_without_a_kink():
    loads = np.linspace(0.01, 10, 5001)
    passed = np.array([load * smooth_scale(load, 0.8) for load in loads])
    np.testing.assert_allclose(passed[loads <= 0.8], loads[loads <= 0.8])
    assert np.all(np.diff(passed) >= -1e-12)
    assert passed.max() <= 1.0 + 1e-12
    slopes = np.diff(passed) / np.diff(loads)
    assert np.abs(np.diff(slopes)).max() < 0.02


@given(st.lists(st.floats(-100, 100), min_size=8, max_size=8))
def test_saturation_keeps_the_direction(values):
    command = np.array(values)
    limited = saturate(command, RATES, LIMITS)
    assert np.linalg.norm(limited[:3]) <= LIMITS.max_speed + 1e-12
    assert abs(limited[3]) <= LIMITS.max_yaw_rate + 1e-12
    assert np.abs(limited[4:]).max() <= LIMITS.max_joint_rate + 1e-12
    # The same factor on all: the cross terms vanish.
    np.testing.assert_allclose(np.outer(limited, command), np.outer(command, limited), atol=1e-9)
    assert limited @ command >= 0


def test_the_arm_s_own_rate_limit_holds_too():
    command = np.array([0, 0, 0, 0, 0, 0, 5.0, 0])
    assert saturate(command, np.array([2.5, 2.5, 0.3, 2.5]), LIMITS)[6] <= 0.3


def test_acceleration_limit_keeps_the_direction_of_the_change():
    before, wanted = np.array([0.2, 0.0, 0.0]), np.array([0.0, 0.6, 0.3, 0.1, 0, 0, 0, 0])
    limited = limit_acceleration(wanted, before, 0.05, LIMITS)
    change = limited[:3] - before
    assert np.linalg.norm(change) == pytest.approx(2.5 * 0.05)
    np.testing.assert_allclose(np.cross(change, wanted[:3] - before), 0, atol=1e-12)
    np.testing.assert_array_equal(limited[3:], wanted[3:])


def test_keep_clear_takes_back_the_approach_alone():
    J = np.hstack([np.eye(3), np.zeros((3, 5))])
    command = np.array([0.5, 0.2, 0.9, 0.1, 0, 0, 0, 0])
    close = np.array([0.0, 0.0, LIMITS.min_distance])
    limited = keep_clear(command, close, J, None, LIMITS)
    np.testing.assert_allclose(limited, [0.5, 0.2, 0.0, 0.1, 0, 0, 0, 0], atol=1e-12)
    np.testing.assert_array_equal(keep_clear(-command, close, J, None, LIMITS), -command)
    far = np.array([0.0, 0.0, 2.0])
    np.testing.assert_array_equal(keep_clear(command, far, J, None, LIMITS), command)


def test_keep_clear_counts_what_the_arm_does():
    """The arm alone pushes the camera towards the object: the vehicle backs off as fast."""
    J = np.hstack([np.eye(3), np.zeros((3, 1)), 0.2 * np.eye(3, 4)])
    command = np.array([0.0, 0, 0, 0, 0, 0, 1.0, 0])
    limited = keep_clear(command, np.array([0, 0, 0.2]), J, None, LIMITS)
    assert limited[2] == pytest.approx(-0.2)


def test_keep_clear_stops_where_ground_and_object_leave_no_way():
    """Told to sink from below the ground limit towards an object straight above the camera."""
    J = np.hstack([np.eye(3), np.zeros((3, 1)), 0.5 * np.eye(3, 4)])
    J[:3, :3] = np.diag([1.0, -1.0, -1.0])
    command = np.array([0.0, 0, -0.1, 0, 0, 0, 1.0, 0])
    limited = keep_clear(command, np.array([0, 0, -0.2]), J, 0.0, LIMITS)
    approach = np.array([0, 0, -1.0]) @ J @ limited
    assert approach <= 1e-9
    assert limited[2] >= 0


@pytest.mark.parametrize(("height", "v_z", "expected"), [
    (0.3, -0.5, 0.0), (0.5, -0.5, -0.2), (0.1, 0.4, 0.4), (10.0, 0.4, 0.0), (5.0, -0.5, -0.5),
])  # fmt: skip
def test_height_limits_are_neared_slowly(height: float, v_z: float, expected: float):
    J = np.hstack([np.eye(3), np.zeros((3, 5))])
    command = np.array([0.1, 0, v_z, 0, 0, 0, 0, 0])
    limited = keep_clear(command, np.array([2.0, 0, 2.0]), J, height, LIMITS)
    np.testing.assert_allclose(limited[:3], [0.1, 0, expected], atol=1e-12)


@pytest.mark.parametrize("wrong", [{"max_speed": 0.0}, {"min_distance": -1.0}, {"knee": 1.0}])
def test_limits_that_make_no_sense_are_refused(wrong: dict):
    with pytest.raises(InputError, match=next(iter(wrong))):
        SafetyLimits(**wrong)


@pytest.mark.parametrize("yaw", [0.0, 1.0, -3.0])
def test_default_goal_looks_straight_down_on_an_upright_object(yaw: float):
    goal = look_down_goal(0.6, yaw)
    np.testing.assert_allclose(goal[:3, 1], [0, 0, -1], atol=1e-12)  # object's up, to the camera
    np.testing.assert_allclose(goal[:3, 3], [0, 0, 0.6])
    assert np.linalg.det(goal[:3, :3]) == pytest.approx(1.0)
    assert reach_goal(default_aerial_manipulator(), goal).reachable


@pytest.mark.parametrize("tilt_deg", [25.0, 60.0])
def test_a_tilted_goal_sees_the_object_from_aside_in_the_images_middle(tilt_deg: float):
    tilt = np.radians(tilt_deg)
    goal = look_down_goal(0.5, yaw=0.4, tilt=tilt)
    np.testing.assert_allclose(goal[:3, 3], [0, 0, 0.5])
    up_cam = goal[:3, 1]
    np.testing.assert_allclose(up_cam, [0, -np.sin(tilt), -np.cos(tilt)], atol=1e-12)
    # Where the camera is: tilted from above to the side at the image's bottom.
    front_obj = look_down_goal(0.5, yaw=0.4)[:3, :3].T @ [0, 1, 0]
    p_obj_cam = -goal[:3, :3].T @ goal[:3, 3]
    expected = 0.5 * (np.cos(tilt) * np.array([0, 1, 0]) + np.sin(tilt) * front_obj)
    np.testing.assert_allclose(p_obj_cam, expected, atol=1e-12)
    assert reach_goal(default_aerial_manipulator(), goal).reachable


@pytest.mark.parametrize("tilt", [-0.1, 1.1, np.nan])
def test_a_goal_from_below_or_from_the_horizon_is_refused(tilt: float):
    with pytest.raises(InputError, match="tilt"):
        look_down_goal(0.5, tilt=tilt)


def test_goal_file_is_read_back(tmp_path: Path):
    goal = look_down_goal(0.7, 0.4)
    path = tmp_path / "goal.txt"
    np.savetxt(path, goal)
    np.testing.assert_allclose(read_goal(path), goal)
    path.write_text(",".join(str(value) for value in goal.ravel()))
    np.testing.assert_allclose(read_goal(path), goal)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("1 2 3", "3 numbers"),
        ("a " * 16, "not readable"),
        ("2 0 0 0 0 2 0 0 0 0 2 1 0 0 0 1", "not a rotation"),
        ("1 0 0 0 0 1 0 0 0 0 1 -1 0 0 0 1", "behind the camera"),
    ],
)
def test_bad_goal_files_are_named(tmp_path: Path, text: str, problem: str):
    path = tmp_path / "goal.txt"
    path.write_text(text)
    with pytest.raises(DataError, match=problem):
        read_goal(path)
    with pytest.raises(DataError):
        read_goal(tmp_path / "absent.txt")


def test_stand_off_must_be_positive():
    with pytest.raises(InputError, match="stand-off"):
        look_down_goal(0.0)
