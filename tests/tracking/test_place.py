"""The place of a lost object is followed by what stands around it, and recognised again."""

from dataclasses import replace

import numpy as np
import pytest

from baselines.tabletop_scene import look_at_object, make_tabletop
from robust6dof.frames import RgbdFrame
from robust6dof.geometry.transforms import make_transform, rotation_about_y, rotation_error
from robust6dof.tracking.place import PlaceConfig, PlaceMemory

SCENE = make_tabletop("mug", 0)
CONFIG = PlaceConfig()
T_SEEN = look_at_object(0.7, 0.7, 0.8)


def shot(aim_x: float, azimuth: float = 0.7, seed: int = 0):
    """The camera looks beside the object, which stands at the world's origin."""
    rng = np.random.default_rng(seed)
    return SCENE.shoot(look_at_object(azimuth, 0.7, 0.8, aim=(aim_x, 0.0, 0.0)), rng)


def seen(moving: bool = False) -> PlaceMemory:
    first = shot(0.0)
    return PlaceMemory().after_sight(first.frame, first.T_cam_obj, moving, CONFIG)


def dark(frame: RgbdFrame) -> RgbdFrame:
    return replace(frame, rgb=np.zeros_like(frame.rgb))


def looked_at(memory: PlaceMemory, frames: int) -> PlaceMemory:
    for _ in range(frames):
        memory = memory.in_view_without(1 / 30, CONFIG)
    return memory


def assert_near(memory: PlaceMemory, T_cam_obj: np.ndarray) -> None:
    assert memory.T_cam_obj is not None
    assert np.linalg.norm(memory.T_cam_obj[:3, 3] - T_cam_obj[:3, 3]) < 0.015
    assert rotation_error(memory.T_cam_obj[:3, :3], T_cam_obj[:3, :3]) < np.deg2rad(2.0)


def test_the_place_is_followed_while_the_camera_looks_away() -> None:
    memory = seen()
    for number, aim in enumerate((0.15, 0.3, 0.45, 0.55), 1):
        away = shot(aim, seed=number)
        memory = memory.after_loss(away.frame, 0.1, CONFIG)
        assert_near(memory, away.T_cam_obj)


def test_the_place_is_recognised_after_frames_that_show_nothing() -> None:
    memory = seen()
    for _ in range(3):
        memory = memory.after_loss(dark(shot(0.0).frame), 0.1, CONFIG)
        assert memory.T_cam_obj is None
    back = shot(0.1, azimuth=0.8, seed=9)
    assert_near(memory.after_loss(back.frame, 0.1, CONFIG), back.T_cam_obj)


def test_the_object_is_looked_for_near_its_place_and_farther_as_time_goes_by() -> None:
    memory = seen().after_loss(shot(0.1).frame, 0.1, CONFIG)
    aside = make_transform(np.eye(3), np.array([0.0, 0.3, 0.0])) @ shot(0.1).T_cam_obj
    assert memory.surprise(shot(0.1).T_cam_obj, False, CONFIG) < 2.0
    assert memory.surprise(aside, False, CONFIG) == np.inf
    assert replace(memory, seconds=1.0).surprise(aside, False, CONFIG) < 2.0
    assert replace(memory, seconds=0.5, moving=True).surprise(aside, False, CONFIG) < 2.0


def test_an_object_that_was_not_in_its_place_may_be_farther_away() -> None:
    memory = seen().after_loss(shot(0.1).frame, 0.5, CONFIG)
    aside = make_transform(np.eye(3), np.array([0.0, 0.3, 0.0])) @ shot(0.1).T_cam_obj
    assert looked_at(memory, 6).surprise(aside, False, CONFIG) == np.inf
    assert looked_at(memory, 12).surprise(aside, False, CONFIG) < 2.0


def test_where_what_was_followed_and_what_was_seen_differ_both_count() -> None:
    memory = seen().after_loss(shot(0.3).frame, 0.1, CONFIG)
    assert memory.followed is not None
    aside = make_transform(np.eye(3), np.array([0.0, 0.6, 0.0]))
    drifted = replace(memory.followed, T_cam_obj=aside @ memory.followed.T_cam_obj)
    here = shot(0.2)
    memory = replace(memory, followed=drifted).after_loss(here.frame, 0.1, CONFIG)
    assert memory.surprise(here.T_cam_obj, False, CONFIG) < 2.0
    assert memory.surprise(aside @ here.T_cam_obj, False, CONFIG) < 2.0
    between = make_transform(np.eye(3), np.array([0.0, 0.3, 0.0])) @ here.T_cam_obj
    assert memory.surprise(between, False, CONFIG) == np.inf


@pytest.mark.parametrize("moves", [False, True])
def test_an_object_that_moved_among_its_surroundings_is_known_to(moves: bool) -> None:
    memory = seen()
    for number in range(1, 2 * CONFIG.kept_every + 2):
        here = shot(0.005 * number, seed=number)
        step = make_transform(np.eye(3), np.array([0.006 * number * moves, 0.0, 0.0]))
        memory = memory.after_sight(here.frame, here.T_cam_obj @ step, False, CONFIG)
    assert memory.after_loss(shot(0.2).frame, 0.1, CONFIG).moving is moves


def test_of_two_alike_the_one_nearer_to_the_place_is_more_likely() -> None:
    memory = seen().after_loss(shot(0.1).frame, 0.1, CONFIG)
    beside = make_transform(np.eye(3), np.array([0.0, 0.12, 0.0])) @ shot(0.1).T_cam_obj
    near = memory.surprise(shot(0.1).T_cam_obj, False, CONFIG)
    assert near < 0.2 < 1.0 < memory.surprise(beside, False, CONFIG) < np.inf


def test_an_object_that_stood_still_has_not_turned_round() -> None:
    memory = seen().after_loss(shot(0.1).frame, 0.1, CONFIG)
    turned = shot(0.1).T_cam_obj @ make_transform(rotation_about_y(np.pi / 2), np.zeros(3))
    assert memory.surprise(turned, False, CONFIG) == np.inf
    assert memory.surprise(turned, True, CONFIG) < 2.0
    assert replace(memory, seconds=2.0).surprise(turned, False, CONFIG) < 2.0


def test_only_an_object_that_stood_still_is_confirmed_by_its_place() -> None:
    memory, T_there = seen().after_loss(shot(0.1).frame, 0.1, CONFIG), shot(0.1).T_cam_obj
    aside = make_transform(np.eye(3), np.array([0.0, 0.3, 0.0])) @ T_there
    assert memory.confirms(T_there, False, CONFIG)
    assert not memory.confirms(aside, False, CONFIG)
    assert not replace(memory, moving=True).confirms(T_there, False, CONFIG)
    assert looked_at(memory, 6).confirms(T_there, False, CONFIG)
    assert not looked_at(memory, 12).confirms(T_there, False, CONFIG)
    assert memory.in_view_without(5.0, CONFIG).confirms(T_there, False, CONFIG)  # one late image
    assert not replace(memory, T_cam_obj=None).confirms(T_there, False, CONFIG)


@pytest.mark.parametrize(
    ("place", "worth"),
    [((0.0, 0.0, 1.0), True), ((0.9, 0.0, 1.0), False), ((0.0, 0.0, -1.0), False)],
)
def test_only_an_object_that_may_be_in_view_is_looked_for(
    place: tuple[float, float, float], worth: bool
) -> None:
    memory = replace(seen(), T_cam_obj=make_transform(np.eye(3), np.array(place)), seconds=0.1)
    assert memory.worth_a_search(shot(0.0).frame, CONFIG) is worth


def test_either_of_two_places_is_worth_a_search_and_neither_is_known_to_be_empty() -> None:
    frame, T_seen = shot(0.0).frame, make_transform(np.eye(3), np.array([0.0, 0.0, 1.0]))
    T_behind = make_transform(np.eye(3), np.array([0.0, 0.0, -1.0]))
    memory = replace(seen(), T_cam_obj=T_behind, seconds=0.1)
    assert not memory.worth_a_search(frame, CONFIG)
    either = replace(memory, T_cam_other=T_seen)
    assert either.worth_a_search(frame, CONFIG)
    assert either.in_view_without(0.1, CONFIG).looked_s == 0.0
    assert memory.in_view_without(0.1, CONFIG).looked_s > 0.0


def test_where_the_place_is_not_known_for_long_all_is_looked_at() -> None:
    memory, frame = seen(), shot(0.0).frame
    blurred = memory.after_loss(dark(frame), 0.4, CONFIG)
    assert not blurred.worth_a_search(frame, CONFIG)
    assert blurred.after_loss(dark(frame), 0.2, CONFIG).worth_a_search(frame, CONFIG)
    colorless = memory.after_loss(replace(frame, has_color=False), 0.1, CONFIG)
    assert colorless.worth_a_search(frame, CONFIG)
    assert colorless.surprise(make_transform(np.eye(3), np.full(3, 5.0)), False, CONFIG) == 0.0


def test_few_frames_are_kept_and_sight_ends_the_loss() -> None:
    memory, first = seen(), shot(0.0)
    for _ in range(60):
        memory = memory.after_sight(first.frame, first.T_cam_obj, False, CONFIG)
    assert len(memory.seen) <= CONFIG.kept + 1
    lost = memory.after_loss(first.frame, 0.1, CONFIG)
    again = lost.after_sight(first.frame, first.T_cam_obj, False, CONFIG)
    assert (again.followed, again.T_cam_obj, again.seconds) == (None, None, 0.0)
