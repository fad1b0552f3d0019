"""The prediction carries on what was seen, and follows the camera's measured turn."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from baselines.tabletop_scene import look_at_object, make_tabletop
from robust6dof.errors import InputError
from robust6dof.frames import RgbdFrame
from robust6dof.geometry.transforms import invert_transform, make_transform, rotation_error
from robust6dof.tracking.motion import Motion, seconds_between
from robust6dof.tracking.surface.icp import IcpTracker

PERIOD = 1 / 30
T_WORLD_OBJ = make_transform(
    Rotation.from_euler("xyz", [0.4, -0.2, 1.0]).as_matrix(), np.array([0, 0, 0.8])
)


def camera_at(time: float, pivot: float, rate: float = 3.0) -> np.ndarray:
    """T_world_cam of a camera that sways ever faster about a point so far before it [m]."""
    swing = Rotation.from_rotvec([0.4 * np.sin(rate * time**1.5), 0.3 * np.cos(rate * time), 0.1])
    R = swing.as_matrix()
    return make_transform(R, np.array([0, 0, pivot]) - R @ [0, 0, pivot])


def followed(pivot: float, frames: int, gyro: bool = True) -> tuple[Motion, np.ndarray]:
    """The motion learned from so many true poses, and the last of them."""

    def seen(frame: int) -> tuple[np.ndarray, np.ndarray | None]:
        T_world_cam = camera_at(frame * PERIOD, pivot)
        T_cam_obj = invert_transform(T_world_cam) @ T_WORLD_OBJ
        return T_cam_obj, T_world_cam[:3, :3] if gyro else None

    T_last, R_ref_cam = seen(0)
    motion = Motion.at_rest(R_ref_cam)
    for frame in range(1, frames + 1):
        T_cam_obj, R_ref_cam = seen(frame)
        motion = motion.blended(motion.observed(T_last, T_cam_obj, PERIOD, R_ref_cam), 0.5)
        T_last = T_cam_obj
    return motion, T_last


def errors_after(pivot: float, seconds: float, gyro: bool = True) -> tuple[float, float]:
    """Of a prediction so far ahead: turn [rad] and shift [m]."""
    motion, T_last = followed(pivot, 30, gyro)
    T_world_cam = camera_at(30 * PERIOD + seconds, pivot)
    T_true = invert_transform(T_world_cam) @ T_WORLD_OBJ
    T_pred = motion.predict(T_last, seconds, T_world_cam[:3, :3] if gyro else None)
    turn = float(rotation_error(T_pred[:3, :3], T_true[:3, :3]))
    return turn, float(np.linalg.norm(T_pred[:3, 3] - T_true[:3, 3]))


@pytest.mark.parametrize("pivot", [0.0, 0.4, 0.8])
@pytest.mark.parametrize("seconds", [PERIOD, 0.4, 0.9])
def test_a_still_object_turns_as_the_camera_does(pivot: float, seconds: float) -> None:
    turn, _ = errors_after(pivot, seconds)
    blind, _ = errors_after(pivot, seconds, gyro=False)
    assert turn < 1e-9
    assert blind > 100 * turn


def test_how_far_a_turn_shifts_the_object_is_learned() -> None:
    """All of it where the camera alone turns, nothing where it is swung about the object."""
    shares = []
    for pivot in (0.0, 0.4, 0.8):
        camera = followed(pivot, 60)[0].camera
        assert camera is not None
        shares.append(camera.share.value)
    assert shares[0] > 0.7
    assert shares[2] < 0.1
    assert shares[0] > shares[1] > shares[2]


@pytest.mark.parametrize("seconds", [0.4, 0.9])
def test_a_turning_camera_does_not_lose_what_it_passes(seconds: float) -> None:
    _, shift = errors_after(0.0, seconds)
    _, blind = errors_after(0.0, seconds, gyro=False)
    assert shift < 0.5 * blind


def test_an_object_that_turns_by_itself_is_believed_to_turn_on() -> None:
    own = Rotation.from_rotvec([0.0, 0.5 * PERIOD, 0.0]).as_matrix()
    R_ref_cam, T_cam_obj = np.eye(3), T_WORLD_OBJ
    motion, turn = Motion.at_rest(R_ref_cam), Rotation.from_rotvec([0.03, 0, 0]).as_matrix()
    for _ in range(20):
        R_next = R_ref_cam @ turn
        T_next = make_transform(turn.T @ own @ T_cam_obj[:3, :3], T_cam_obj[:3, 3])
        motion = motion.blended(motion.observed(T_cam_obj, T_next, PERIOD, R_next), 0.5)
        R_ref_cam, T_cam_obj = R_next, T_next
    predicted = motion.predict(T_cam_obj, PERIOD, R_ref_cam @ turn)
    expected = turn.T @ own @ T_cam_obj[:3, :3]
    assert rotation_error(predicted[:3, :3], expected) < 1e-3


def test_a_turn_that_was_not_seen_stays_the_cameras() -> None:
    """A can about its axis: it does not turn by itself, but it turns in a turning camera."""
    turn = Rotation.from_rotvec([0, 0.04, 0]).as_matrix()
    motion = Motion.at_rest(np.eye(3))
    newest = motion.observed(T_WORLD_OBJ, T_WORLD_OBJ, PERIOD, turn)
    motion = motion.blended(newest.turning(np.diag([1.0, 0.0, 1.0])), 1.0)
    predicted = motion.predict(T_WORLD_OBJ, PERIOD, turn @ turn)
    np.testing.assert_allclose(predicted[:3, :3], turn.T @ T_WORLD_OBJ[:3, :3], atol=1e-12)


def test_what_is_held_stays_where_it_is_but_for_the_cameras_turn() -> None:
    motion, T_last = followed(0.4, 20)
    assert motion.held(T_last, None) is T_last
    assert Motion.at_rest().held(T_last, np.eye(3)) is T_last
    camera = motion.camera
    assert camera is not None
    turn = Rotation.from_rotvec([0.2, 0.1, 0]).as_matrix()
    T_held = motion.held(T_last, camera.R_ref_cam @ turn)
    np.testing.assert_allclose(T_held[:3, :3], turn.T @ T_last[:3, :3], atol=1e-12)
    back = motion.stopped(camera.R_ref_cam @ turn).held(T_held, camera.R_ref_cam)
    np.testing.assert_allclose(back[:3, :3], T_last[:3, :3], atol=1e-12)


@given(st.integers(0, 1000), st.floats(0.001, 1.0))
@settings(max_examples=30, deadline=None)
def test_without_a_gyro_velocities_alone_are_carried_on(seed: int, seconds: float) -> None:
    rng = np.random.default_rng(seed)
    turns = Rotation.random(2, rng=rng).as_matrix()
    T_old, T_new = (make_transform(R, rng.normal(size=3)) for R in turns)
    for before in (Motion.at_rest(), Motion.at_rest(np.eye(3))):
        motion = before.blended(before.observed(T_old, T_new, seconds, None), 0.5)
        plain = Motion.between(T_old, T_new, seconds)
        np.testing.assert_array_equal(motion.linear, 0.5 * plain.linear)
        predicted = motion.predict(T_new, seconds, np.eye(3))
        np.testing.assert_array_equal(predicted[:3, 3], T_new[:3, 3] + motion.linear * seconds)
        R_turn = Rotation.from_rotvec(motion.angular * seconds).as_matrix()
        np.testing.assert_array_equal(predicted[:3, :3], R_turn @ T_new[:3, :3])


def test_an_orientation_that_is_no_rotation_is_refused() -> None:
    rgb, depth = np.zeros((8, 10, 3), np.uint8), np.zeros((8, 10), np.float32)
    K = np.array([[10.0, 0, 5], [0, 10.0, 4], [0, 0, 1]])
    for wrong, words in ((2 * np.eye(3), "not a rotation"), (np.full((3, 3), np.nan), "NaN")):
        with pytest.raises(InputError, match=f"R_ref_cam .*{words}"):
            RgbdFrame(rgb, depth, K, R_ref_cam=wrong)


def after_a_jump(gyro: bool) -> tuple[float, float, float]:
    """Turn [rad] and shift [m] that registration is off by, and its confidence, after the camera
    panned and rolled by 33 degrees between two frames."""
    rng, scene = np.random.default_rng(0), make_tabletop("mug", 0)
    away = Rotation.from_euler("xyz", [8, -10, 30], degrees=True)

    def shoot(index: int) -> tuple[RgbdFrame, np.ndarray]:
        sway = Rotation.from_rotvec([0.03 * np.sin(2 * index), 0.03 * np.cos(2 * index), 0])
        R_cam_steady = (away * sway if index == 7 else sway).as_matrix()
        T_cam_world = make_transform(R_cam_steady, np.zeros(3)) @ look_at_object(0.7, 0.7, 0.8)
        shot = scene.shoot(T_cam_world, rng, stamp=index / 20)
        R_ref_cam = T_cam_world[:3, :3].T if gyro else None
        return replace(shot.frame, R_ref_cam=R_ref_cam), shot.T_cam_obj

    tracker, (frame, T_true) = IcpTracker("mug"), shoot(0)
    track = tracker.start(frame, T_cam_obj=T_true, extents=scene.model.extents)
    for index in range(1, 8):
        frame, T_true = shoot(index)
        track = tracker.step(track, frame)
    turn = float(rotation_error(track.T_cam_obj[:3, :3], T_true[:3, :3]))
    shift = float(np.linalg.norm(track.T_cam_obj[:3, 3] - T_true[:3, 3]))
    return turn, shift, track.confidence


def test_a_tracker_with_a_gyro_follows_where_it_would_be_lost() -> None:
    turn, shift, confidence = after_a_jump(gyro=True)
    assert turn < np.deg2rad(5)
    assert shift < 0.02
    assert confidence > 0.5
    assert after_a_jump(gyro=False)[2] < 0.5


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        (1.0, 1.5, 0.5),
        (np.float64(1.0), np.float64(1.5), 0.5),
        (1.5, 1.0, 1 / 30),
        (1.0, 1.0, 1 / 30),
        (1.0, 21.0, 1 / 30),
        (None, 1.0, 1 / 30),
        (1.0, np.nan, 1 / 30),
        (1.0, np.inf, 1 / 30),
    ],
)
def test_stamps_that_tell_no_time_count_as_one_period(
    old: float | None, new: float | None, expected: float
) -> None:
    seconds = seconds_between(old, new)
    assert type(seconds) is float
    assert seconds == pytest.approx(expected)


def test_any_gap_can_be_asked_for() -> None:
    assert seconds_between(1.0, 21.0, longest=np.inf) == 20.0
    assert seconds_between(1.0, np.inf, longest=np.inf) == pytest.approx(1 / 30)
