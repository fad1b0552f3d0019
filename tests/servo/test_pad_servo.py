"""The servo's states, its memory and the limits that always hold."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from robust6dof.errors import InputError
from robust6dof.frames import TrackState
from robust6dof.geometry.transforms import make_transform, rotation_about_y
from robust6dof.robot.aerial_manipulator import default_aerial_manipulator
from robust6dof.servo.goal import look_down_goal
from robust6dof.servo.pad_servo import PadServo, PadServoConfig, ServoCommand
from robust6dof.servo.safety import SafetyLimits

ROBOT = default_aerial_manipulator()
GOAL = look_down_goal(0.5)
STILL = np.zeros(2)
REST = np.zeros(4)


def _seen(offset: tuple[float, float, float] = (0.05, -0.02, 0.4), turn: float = 0.0) -> np.ndarray:
    R = Rotation.from_rotvec([turn, 0, 0]).as_matrix() @ GOAL[:3, :3]
    return make_transform(R, GOAL[:3, 3] + offset)


def _step(servo: PadServo, T_cam_obj: np.ndarray | None, stamp: float, **more) -> ServoCommand:
    return servo.step(T_cam_obj, GOAL, REST, STILL, stamp, **more)


def _guided(steps: int = 5) -> PadServo:
    servo = PadServo(ROBOT)
    for i in range(steps):
        assert _step(servo, _seen(), 0.05 * i).state == "guiding"
    return servo


def _assert_holds(command: ServoCommand, state: str) -> None:
    assert command.state == state
    assert command.state.holding
    np.testing.assert_array_equal(command.as_vector, 0)


def test_one_line_call():
    servo = PadServo(default_aerial_manipulator())
    command = servo.step(_seen(), GOAL, np.zeros(4), np.zeros(2), 12.5)
    assert command.state == "guiding"
    assert command.velocity_body.shape == (3,)
    assert command.joint_rates.shape == (4,)
    assert command.velocity_body[2] < 0  # too far above: descend
    assert command.translation_error == pytest.approx(np.linalg.norm([0.05, -0.02, 0.4]))


def test_signs_of_the_commands():
    """Body axes: x forward, y left. The image's top is forward at rest."""
    servo = PadServo(ROBOT, PadServoConfig(soft_start=0))
    right_of_image = _step(servo, _seen((0.1, 0, 0)), 0.0)
    assert right_of_image.velocity_body[1] < -0.005  # object to the right: fly right
    servo.start()
    top_of_image = _step(servo, _seen((0, -0.1, 0)), 0.0)
    assert top_of_image.velocity_body[0] > 0.005
    servo.start()
    turned = make_transform(GOAL[:3, :3] @ rotation_about_y(0.5), GOAL[:3, 3])
    command = _step(servo, turned, 0.0)
    assert command.yaw_rate * command.joint_rates[0] > 0  # vehicle and arm share the turn
    after = ROBOT.camera_jacobian(REST)[3:] @ np.array(
        [*command.velocity_body, 0, 0, command.yaw_rate, *command.joint_rates]
    )
    error = Rotation.from_matrix(GOAL[:3, :3] @ turned[:3, :3].T).as_rotvec()
    np.testing.assert_allclose(after, -0.25 * error, atol=1e-9)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_invalid_pose_holds_and_guidance_resumes_by_itself(bad: float):
    servo = _guided()
    broken = _seen()
    broken[0, 3] = bad
    _assert_holds(_step(servo, broken, 0.25), "hold_invalid")
    assert _step(servo, _seen(), 0.3).state == "guiding"


def test_scaled_or_mirrored_rotation_holds():
    servo = _guided()
    scaled = _seen()
    scaled[:3, :3] *= 1.3
    _assert_holds(_step(servo, scaled, 0.25), "hold_invalid")
    mirrored = _seen()
    mirrored[:3, 0] *= -1
    _assert_holds(_step(servo, mirrored, 0.3), "hold_invalid")


def test_nan_readings_hold():
    servo = _guided()
    for joints, tilt in ((REST * np.nan, STILL), (REST, STILL * np.nan)):
        _assert_holds(servo.step(_seen(), GOAL, joints, tilt, 0.3), "hold_invalid")
    _assert_holds(_step(servo, _seen(), 0.3, velocity_body=np.full(3, np.nan)), "hold_invalid")
    _assert_holds(_step(servo, _seen(), np.nan), "hold_invalid")
    assert _step(servo, _seen(), 0.35).state == "guiding"


@pytest.mark.parametrize(
    "what",
    [
        {"track_state": TrackState.LOST},
        {"track_state": TrackState.RECOVERING},
        {"confidence": 0.05},
        {"confidence": np.nan},
    ],
)
def test_lost_track_holds_and_guidance_resumes_by_itself(what: dict):
    servo = _guided()
    _assert_holds(_step(servo, _seen(), 0.25, **what), "hold_lost")
    _assert_holds(_step(servo, None, 0.3), "hold_lost")
    assert _step(servo, _seen(), 0.35, track_state=TrackState.UNCERTAIN).state == "guiding"


def test_object_behind_the_camera_holds():
    servo = PadServo(ROBOT)
    _assert_holds(_step(servo, _seen((0, 0, -0.9)), 0.0), "hold_lost")


def test_stale_pose_holds_when_the_clock_is_told():
    servo = _guided()
    assert _step(servo, _seen(), 0.25, now=0.5).state == "guiding"
    _assert_holds(_step(servo, _seen(), 0.3, now=0.9), "hold_stale")
    assert _step(servo, _seen(), 0.9, now=1.0).state == "guiding"


def test_the_same_image_again_and_again_holds():
    servo = _guided()
    states = [str(_step(servo, _seen(), 0.2).state) for _ in range(12)]
    assert states[:8] == ["guiding"] * 8  # 0.4 s of 50 ms periods
    assert states[9:] == ["hold_stale"] * 3
    assert _step(servo, _seen(), 0.8).state == "guiding"


def test_an_older_image_holds_and_a_clock_set_back_begins_anew():
    servo = _guided()
    _assert_holds(_step(servo, _seen(), 0.1), "hold_stale")
    assert _step(servo, _seen(), 0.25).state == "guiding"
    _assert_holds(_step(servo, _seen(), -100.0), "hold_stale")
    assert _step(servo, _seen(), -99.95).state == "guiding"


def test_a_jump_holds_one_outlier_is_forgotten_a_lasting_one_believed():
    servo = _guided()
    _assert_holds(_step(servo, _seen((0.6, 0, 0.4)), 0.25), "hold_jump")
    assert _step(servo, _seen(), 0.3).state == "guiding"
    _assert_holds(_step(servo, _seen(turn=1.5), 0.35), "hold_jump")
    states = [str(_step(servo, _seen((0.6, 0, 0.6)), 0.4 + 0.05 * i).state) for i in range(12)]
    assert states[:9] == ["hold_jump"] * 9
    assert states[9:] == ["guiding"] * 3


def test_jumps_that_agree_with_nothing_are_never_believed():
    servo = _guided()
    rng = np.random.default_rng(0)
    for i in range(40):
        wild = make_transform(Rotation.random(rng=rng).as_matrix(), rng.uniform(1, 3, 3))
        command = _step(servo, wild, 0.25 + 0.05 * i)
        assert command.state in ("hold_jump", "guiding")
        if command.state == "guiding":  # allowed only once enough time passed since the last
            assert i * 0.05 > 0.4


def test_a_symmetric_object_may_flip_its_yaw():
    servo = PadServo(ROBOT)
    for i in range(6):
        T = make_transform(GOAL[:3, :3] @ rotation_about_y(2.5 * i), GOAL[:3, 3])
        assert _step(servo, T, 0.05 * i, symmetric=True).state == "reached"


def test_stop_test_wants_both_errors_and_has_hysteresis():
    def state(servo: PadServo, off: float, turn: float, stamp: float) -> str:
        return str(_step(servo, _seen((off, 0, 0), turn), stamp).state)

    servo = PadServo(ROBOT)
    assert state(servo, 0.039, 0.08, 0.00) == "guiding"  # only one is below
    assert state(servo, 0.045, 0.07, 0.05) == "guiding"
    assert state(servo, 0.039, 0.07, 0.10) == "reached"
    assert state(servo, 0.055, 0.10, 0.15) == "reached"  # within 1.5 thresholds
    assert state(servo, 0.061, 0.01, 0.20) == "guiding"
    assert state(servo, 0.045, 0.01, 0.25) == "guiding"  # and back only below one
    assert state(servo, 0.039, 0.01, 0.30) == "reached"
    assert state(servo, 0.001, 0.12, 0.35) == "guiding"


def test_goal_that_is_no_transform_is_refused():
    servo = PadServo(ROBOT)
    with pytest.raises(InputError, match="behind the camera"):
        servo.step(_seen(), _seen((0, 0, -2)), REST, STILL, 0.0)
    with pytest.raises(InputError, match="T_cam_obj_goal"):
        servo.step(_seen(), np.zeros((4, 4)), REST, STILL, 0.0)


def test_guidance_begins_gently_and_a_short_hold_costs_little():
    servo = PadServo(ROBOT)
    speeds = [np.linalg.norm(_step(servo, _seen(), 0.05 * i).as_vector) for i in range(24)]
    assert speeds[0] < 0.01 * speeds[-1]
    assert np.all(np.diff(speeds) > -1e-9)
    assert speeds[20] == pytest.approx(speeds[-1])  # the law itself, after a second
    assert _step(servo, None, 1.2).state == "hold_lost"
    again = np.linalg.norm(_step(servo, _seen(), 1.25).as_vector)
    assert again > 0.25 * speeds[-1]  # what the limit on the acceleration lets through
    for i in range(30):
        _step(servo, None, 1.3 + 0.05 * i)
    assert np.linalg.norm(_step(servo, _seen(), 2.8).as_vector) < 0.01 * speeds[-1]


def test_start_forgets_the_past():
    servo = _guided()
    servo.start()
    fresh = PadServo(ROBOT)
    far = _seen((0.6, 0, 0.6))
    np.testing.assert_array_equal(
        _step(servo, far, 0.01).as_vector, _step(fresh, far, 0.01).as_vector
    )


_SERVOS = {
    law: PadServo(ROBOT, PadServoConfig(law=law))
    for law in ("printed", "coupled", "feedforward", "ibvs", "pbvs")
}
_vectors = st.lists(st.floats(-3, 3), min_size=3, max_size=3).map(np.array)


@given(
    law=st.sampled_from(sorted(_SERVOS)),
    t_cam_obj=st.tuples(st.floats(-2, 2), st.floats(-2, 2), st.floats(0.021, 4)),
    turn=_vectors,
    posture=st.lists(st.floats(-0.05, 1.05), min_size=4, max_size=4),
    tilt_rates=st.tuples(st.floats(-20, 20), st.floats(-20, 20)),
    velocity=_vectors,
    height=st.none() | st.floats(-1, 15),
    steps=st.integers(1, 3),
)
def test_no_command_ever_breaks_a_limit(
    law, t_cam_obj, turn, posture, tilt_rates, velocity, height, steps
):
    servo, limits = _SERVOS[law], SafetyLimits()
    servo.start()
    arm = ROBOT.arm
    joints = arm.lower + np.array(posture) * (arm.upper - arm.lower)
    T = make_transform(Rotation.from_rotvec(turn).as_matrix(), np.array(t_cam_obj))
    before = np.zeros(3)
    for i in range(steps):
        command = servo.step(
            T,
            GOAL,
            joints,
            np.array(tilt_rates),
            0.05 * i,
            velocity_body=velocity,
            height=height,
        )
        _assert_within_limits(command, joints, T, height, limits)
        clear_of_object = np.linalg.norm(t_cam_obj) > 1.5 and height is None
        if i > 0 and clear_of_object:
            change = np.linalg.norm(command.velocity_body - before)
            assert change <= limits.max_acceleration * 0.05 + 1e-9
        before = command.velocity_body


def _assert_within_limits(
    command: ServoCommand,
    joints: np.ndarray,
    T_cam_obj: np.ndarray,
    height: float | None,
    limits: SafetyLimits,
) -> None:
    arm, x = ROBOT.arm, command.as_vector
    assert np.isfinite(x).all()
    assert np.linalg.norm(command.velocity_body) <= limits.max_speed + 1e-9
    assert abs(command.yaw_rate) <= limits.max_yaw_rate + 1e-9
    assert np.all(np.abs(command.joint_rates) <= limits.max_joint_rate + 1e-9)
    ahead = joints + command.joint_rates * 0.05
    assert np.all(ahead <= np.maximum(joints, arm.upper) + 1e-9)
    assert np.all(ahead >= np.minimum(joints, arm.lower) - 1e-9)
    if height is not None and height <= limits.min_height:
        assert command.velocity_body[2] >= -1e-9
    if height is not None and height >= limits.max_height:
        assert command.velocity_body[2] <= 1e-9
    t = T_cam_obj[:3, 3]
    distance = np.linalg.norm(t)
    q_dot = np.concatenate([command.velocity_body, [0, 0, command.yaw_rate], command.joint_rates])
    approach = t / distance @ (ROBOT.camera_jacobian(joints) @ q_dot)[:3]
    assert approach <= limits.brake * max(distance - limits.min_distance, 0) + 1e-6


@given(
    values=st.lists(
        st.sampled_from([np.nan, np.inf, -np.inf, 0.0, 1e300, -1e300, 1e-300]),
        min_size=16,
        max_size=16,
    ),
    joint=st.sampled_from([np.nan, np.inf, 0.0, 1e6]),
    stamp=st.sampled_from([np.nan, np.inf, -1.0, 0.0, 1e12]),
)
def test_garbage_never_raises_and_never_becomes_a_command(values, joint, stamp):
    servo = _SERVOS["feedforward"]
    servo.start()
    _step(servo, _seen(), 0.0)
    for T in (np.array(values).reshape(4, 4), _seen()):
        command = servo.step(T, GOAL, np.array([joint, 0, 0, 0]), STILL, stamp)
        assert np.isfinite(command.as_vector).all()
        assert np.linalg.norm(command.velocity_body) <= 1.0 + 1e-9
