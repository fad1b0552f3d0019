"""A lost object is looked for where it can be; with the shipped weights it is found again."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from baselines.tabletop_scene import K, look_at_object, make_tabletop
from robust6dof.frames import RgbdFrame, TrackState
from robust6dof.geometry.transforms import axis_error, make_transform, rotation_error
from robust6dof.solver.absolute import AbsoluteFit
from robust6dof.tracking.recovery import RecoveryConfig, is_same_pose, other_turns, poses_to_try
from robust6dof.tracking.tracker import Tracker

SCENE = make_tabletop("mug", 0)
SHOT = SCENE.shoot(look_at_object(0.7, 0.7, 0.8), np.random.default_rng(0))
SCALE = SCENE.model.scale
UNKNOWN = np.full(3, np.nan)
FAR = make_transform(Rotation.from_rotvec([0.3, 0.1, -0.2]).as_matrix(), np.array([0.3, 0, 0.2]))


def nearest(guesses: list[np.ndarray]) -> np.ndarray:
    centre = SHOT.T_cam_obj[:3, 3]
    return min(guesses, key=lambda T: float(np.linalg.norm(T[:3, 3] - centre)))


def test_a_guess_stands_upright_on_the_object() -> None:
    """From a last pose that is 25 cm and a good 20 degrees off."""
    T_last = FAR @ SHOT.T_cam_obj
    guess = nearest(poses_to_try(SHOT.frame, T_last, SCALE, UNKNOWN, True, RecoveryConfig()))
    assert np.linalg.norm(guess[:3, 3] - SHOT.T_cam_obj[:3, 3]) < 0.04
    assert axis_error(guess[:3, :3], SHOT.T_cam_obj[:3, :3]) < np.deg2rad(3.0)


def test_objects_with_a_front_are_tried_from_all_sides() -> None:
    config = RecoveryConfig(turn_odds=0.0)
    once = poses_to_try(SHOT.frame, SHOT.T_cam_obj, SCALE, UNKNOWN, True, config)
    turned = poses_to_try(SHOT.frame, SHOT.T_cam_obj, SCALE, UNKNOWN, False, config)
    assert len(turned) == 8 * len(once)
    yaws = [
        Rotation.from_matrix(once[0][:3, :3].T @ T[:3, :3]).as_rotvec(degrees=True)[1]
        for T in turned[:8]
    ]
    np.testing.assert_allclose(sorted(np.round(yaws) % 360), np.arange(0, 360, 45), atol=1e-6)


def test_the_other_turns_of_what_was_found_are_about_its_own_axis() -> None:
    turned = other_turns(SHOT.T_cam_obj, RecoveryConfig(turns=4))
    apart = [rotation_error(T[:3, :3], SHOT.T_cam_obj[:3, :3]) for T in turned]
    np.testing.assert_allclose(np.rad2deg(apart), [90.0, 90.0, 180.0])
    for T in turned:
        np.testing.assert_allclose(T[:3, [1, 3]], SHOT.T_cam_obj[:3, [1, 3]], atol=1e-12)


def test_the_piece_of_the_right_colour_is_tried_first() -> None:
    color = SHOT.frame.rgb[SHOT.mask].mean(axis=0)
    guess = poses_to_try(SHOT.frame, SHOT.T_cam_obj, SCALE, color, True, RecoveryConfig())[0]
    assert np.linalg.norm(guess[:3, 3] - SHOT.T_cam_obj[:3, 3]) < 0.05


def test_things_of_another_size_are_left_out() -> None:
    assert (
        poses_to_try(SHOT.frame, SHOT.T_cam_obj, 20 * SCALE, UNKNOWN, True, RecoveryConfig()) == []
    )


@pytest.mark.parametrize(
    ("change", "scale", "same"),
    [
        (np.eye(4), 1.0, True),
        (make_transform(np.eye(3), np.array([0, 0, 0.3 * SCALE])), 1.0, False),
        (make_transform(Rotation.from_rotvec([0.6, 0, 0]).as_matrix(), np.zeros(3)), 1.0, False),
        (np.eye(4), 1.4, False),
        (make_transform(Rotation.from_rotvec([0, 0.6, 0]).as_matrix(), np.zeros(3)), 1.0, True),
    ],
)
def test_one_view_confirms_a_symmetric_pose(change: np.ndarray, scale: float, same: bool) -> None:
    anchor = AbsoluteFit(SHOT.T_cam_obj @ change, scale * SCALE, np.ones(5, bool), 0.0)
    assert is_same_pose(anchor, SHOT.T_cam_obj, SCALE, symmetric=True) is same


def test_the_object_is_found_again_after_a_gap_elsewhere_in_the_image() -> None:
    """The camera looks away, and comes back from another side: what was carried is of no use."""
    rng = np.random.default_rng(3)
    tracker = Tracker.from_pretrained(category="mug", device="cpu")
    first = SCENE.shoot(look_at_object(0.7, 0.7, 0.6), rng, stamp=0.0)
    track = tracker.start(first.frame, T_cam_obj=first.T_cam_obj, extents=SCENE.model.extents)
    dark = RgbdFrame(np.zeros_like(first.frame.rgb), np.zeros_like(first.frame.depth), K)
    for index in range(5):
        track = tracker.step(track, replace(dark, stamp=0.05 + index / 30))
    assert track.state is TrackState.LOST
    again = SCENE.shoot(look_at_object(1.1, 0.8, 0.7, aim=(0.12, 0.05, 0.0)), rng)
    for index in range(12):
        track = tracker.step(track, replace(again.frame, stamp=0.3 + index / 30))
        if track.state is TrackState.TRACKING:
            break
    assert track.state is TrackState.TRACKING
    assert np.linalg.norm(track.T_cam_obj[:3, 3] - again.T_cam_obj[:3, 3]) < 0.03
    assert axis_error(track.T_cam_obj[:3, :3], again.T_cam_obj[:3, :3]) < np.deg2rad(10.0)
