"""The closed loop without dynamics: what each law converges to, and how fast."""

from __future__ import annotations

import numpy as np
import pytest

from robust6dof.geometry.transforms import make_transform, rotation_about_y
from robust6dof.robot.aerial_manipulator import default_aerial_manipulator
from robust6dof.servo.goal import look_down_goal
from robust6dof.servo.ideal_loop import (
    IdealRun,
    Start,
    random_start,
    run_ideal,
    time_bound,
    unlimited_joints,
)
from robust6dof.servo.interaction import extended_image_point
from robust6dof.servo.pad_servo import PadServo, PadServoConfig
from robust6dof.servo.safety import SafetyLimits

ROBOT = default_aerial_manipulator()
GOAL = look_down_goal(0.5)
NO_LIMITS = SafetyLimits(max_speed=50, max_yaw_rate=50, max_joint_rate=50, max_acceleration=1e4)


def _start(seed: int) -> Start:
    return random_start(ROBOT, GOAL, np.random.default_rng(seed))


def _image_errors(run: IdealRun) -> np.ndarray:
    goal = extended_image_point(GOAL[:3, 3])
    return np.stack([extended_image_point(T[:3, 3]) - goal for T in run.T_cam_obj])


def _ratio_to_bound(run: IdealRun) -> float:
    config = PadServoConfig()
    bound = time_bound(run.translation_errors[0], run.rotation_errors[0], config)
    return run.time_to(config.delta_T, config.delta_R) / bound


@pytest.mark.parametrize("seed", [1, 4])
def test_coupled_errors_follow_the_analytic_exponentials(seed: int):
    servo = PadServo(ROBOT, PadServoConfig(limits=NO_LIMITS, rate_hz=50, soft_start=0))
    run = run_ideal(servo, _start(seed), GOAL, 2.0)
    errors = _image_errors(run)
    decay = np.exp(-0.27 * run.times)[:, None]
    scale = np.linalg.norm(errors[0])
    # Held commands differ from the continuous law by a part of λ · 20 ms.
    np.testing.assert_allclose(errors, decay * errors[0], atol=0.01 * scale)
    theta = run.rotation_errors
    np.testing.assert_allclose(theta, theta[0] * np.exp(-0.25 * run.times), rtol=0.005)


def test_a_soft_start_only_bends_the_exponentials_time():
    """exp(−λ t) becomes exp(−λ ∫ share dt): along the same path, without a jump."""
    config = PadServoConfig(limits=NO_LIMITS, rate_hz=50, soft_start=1.0)
    run = run_ideal(PadServo(ROBOT, config), _start(1), GOAL, 2.0)
    # The share in force while each command holds; the first is that of one period.
    shares = [config.share_in_force(min(t + config.period, 1.0)) for t in run.times]
    spent = np.concatenate([[0.0], np.cumsum(shares)[:-1]]) * config.period
    errors = _image_errors(run)
    expected = np.exp(-0.27 * spent)[:, None] * errors[0]
    np.testing.assert_allclose(errors, expected, atol=0.01 * np.linalg.norm(errors[0]))
    speeds = [np.linalg.norm(command.as_vector) for command in run.commands]
    assert speeds[0] < 0.01 * max(speeds)
    assert np.diff(speeds[:50]).max() < 0.05 * max(speeds)


@pytest.mark.parametrize("seed", [0])
def test_discretisation_is_all_that_separates_the_loop_from_its_exponential(seed: int):
    """Twice the rate, half the deviation."""

    def deviation(rate_hz: float) -> float:
        servo = PadServo(ROBOT, PadServoConfig(limits=NO_LIMITS, rate_hz=rate_hz, soft_start=0))
        run = run_ideal(servo, _start(seed), GOAL, 1.0)
        errors = _image_errors(run)
        return float(np.abs(errors - np.exp(-0.27 * run.times)[:, None] * errors[0]).max())

    assert deviation(80) / deviation(40) == pytest.approx(0.5, abs=0.1)


@pytest.mark.parametrize("law", ["coupled", "feedforward"])
@pytest.mark.parametrize("seed", [2])
def test_neither_error_ever_grows_without_disturbance(law, seed: int):
    """With the default limits: they slow the approach, never turn it."""
    run = run_ideal(PadServo(ROBOT, PadServoConfig(law=law)), _start(seed), GOAL, 5.0)
    assert np.diff(np.linalg.norm(_image_errors(run), axis=1)).max() < 1e-9
    assert np.diff(run.rotation_errors).max() < 1e-9


def _converges(seed: int) -> None:
    run = run_ideal(PadServo(ROBOT), _start(seed), GOAL, 40.0, stop_when_reached=True)
    assert run.commands[-1].state == "reached"
    assert _ratio_to_bound(run) < 1.05
    inside = (run.joints >= ROBOT.arm.lower) & (run.joints <= ROBOT.arm.upper)
    assert inside.all()


@pytest.mark.parametrize("seed", range(2))
def test_coupled_law_converges(seed: int):
    _converges(seed)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(40))
def test_coupled_law_converges_from_every_random_start(seed: int):
    _converges(seed)


def test_mended_printed_law_converges_slower_than_the_coupled_one():
    seed = 0
    printed = PadServo(unlimited_joints(ROBOT), PadServoConfig(law="printed", rate_hz=10))
    slow = run_ideal(printed, _start(seed), GOAL, 60.0, stop_when_reached=True)
    coupled = PadServo(ROBOT, PadServoConfig(rate_hz=10))
    fast = run_ideal(coupled, _start(seed), GOAL, 60.0, stop_when_reached=True)
    assert slow.commands[-1].state == "reached"
    assert _ratio_to_bound(slow) > 1.3 * _ratio_to_bound(fast)


def test_printed_rotation_error_does_not_reach_a_goal_above_an_upright_object():
    """ΔR = R(t)ᵀR* acts in the object's axes, turned from the camera's: it never settles."""
    config = PadServoConfig(law="printed", rotation_error="printed", rate_hz=10)
    run = run_ideal(PadServo(unlimited_joints(ROBOT), config), _start(1), GOAL, 30.0)
    assert run.commands[-1].state == "guiding"
    assert run.rotation_errors[-1] > 0.075


def test_printed_rotation_error_does_where_the_goal_is_near_the_identity():
    """A camera that looks along the object's z axis: there both error vectors nearly agree."""
    goal = make_transform(np.eye(3), np.array([0, 0, 0.5]))
    start = Start(
        ROBOT.arm.rest.copy(), make_transform(rotation_about_y(0.3), np.array([0, 0, 0.8]))
    )
    config = PadServoConfig(law="printed", rotation_error="printed", rate_hz=10)
    run = run_ideal(PadServo(ROBOT, config), start, goal, 30.0, stop_when_reached=True)
    assert run.commands[-1].state == "reached"


def test_moving_target_is_lost_by_printed_trailed_by_coupled_and_followed_by_feedforward():
    start = Start(ROBOT.arm.rest.copy(), GOAL.copy())
    ahead = np.array([0.2, 0.0, 0.0])

    def final_lags(law) -> np.ndarray:
        servo = PadServo(ROBOT, PadServoConfig(law=law, rate_hz=10))
        run = run_ideal(servo, start, GOAL, 20.0, target_velocity=lambda _: ahead)
        return run.translation_errors[[-51, -1]]

    printed, coupled, feedforward = map(final_lags, ("printed", "coupled", "feedforward"))
    assert printed[1] > 1.3
    assert printed[1] > printed[0] + 0.2  # and it goes on falling behind
    assert coupled[1] == pytest.approx(0.2 / 0.27, rel=0.01)
    assert feedforward[1] < 1e-3


def test_feedforward_follows_a_target_that_circles_and_turns():
    start = Start(ROBOT.arm.rest.copy(), GOAL.copy())
    servo = PadServo(ROBOT, PadServoConfig(law="feedforward", soft_start=0))
    run = run_ideal(
        servo,
        start,
        GOAL,
        10.0,
        target_velocity=lambda t: 0.3 * np.array([np.cos(0.3 * t), np.sin(0.3 * t), 0.0]),
        target_yaw_rate=0.3,
    )
    assert run.translation_errors[100:].max() < 0.02
    assert run.rotation_errors[100:].max() < 0.05


def test_a_symmetric_object_that_spins_is_not_chased():
    start = Start(ROBOT.arm.rest.copy(), GOAL.copy())
    for law in ("coupled", "feedforward"):
        run = run_ideal(
            PadServo(ROBOT, PadServoConfig(law=law)),
            start,
            GOAL,
            4.0,
            target_yaw_rate=0.5,
            symmetric=True,
        )
        for command in run.commands:
            np.testing.assert_allclose(command.as_vector, 0, atol=1e-6)
        assert {command.state for command in run.commands} == {"reached"}


@pytest.mark.parametrize("law", ["ibvs", "pbvs"])
def test_the_laws_to_compare_with_converge(law):
    run = run_ideal(
        PadServo(ROBOT, PadServoConfig(law=law, rate_hz=10)),
        _start(0),
        GOAL,
        40.0,
        stop_when_reached=True,
    )
    assert run.commands[-1].state == "reached"
