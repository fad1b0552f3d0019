"""What is found elsewhere than where it stood is doubted, and nothing is learned from it yet."""

from collections.abc import Iterator

import numpy as np
import pytest

from baselines.tabletop_scene import look_at_object, make_tabletop
from robust6dof.frames import RgbdFrame, Track, TrackState
from robust6dof.geometry.transforms import make_transform
from robust6dof.tracking.states import StateRules
from robust6dof.tracking.tracker import Tracker

SCENE = make_tabletop("mug", 0, clutter=0)
AWAY = make_transform(np.eye(3), np.array([0.16, 0.0, -0.1]))
PATIENCE = StateRules().unplaced_patience


@pytest.fixture(scope="module")
def tracker() -> Tracker:
    return Tracker.from_pretrained(category="mug", device="cpu")


def frames(T_world_obj: np.ndarray, count: int, stamp: float) -> Iterator[RgbdFrame]:
    """The camera sways; the object is where it is told to be."""
    for index in range(count):
        T_cam_world = look_at_object(0.7 + 0.01 * index, 0.7, 0.7, (0.08, 0.0, -0.05))
        rng = np.random.default_rng(index)
        yield SCENE.shoot_object_at(T_world_obj, T_cam_world, rng, stamp + index / 30).frame


@pytest.fixture(scope="module")
def followed(tracker: Tracker) -> Track:
    """Where it stood at first."""
    stood = list(frames(np.eye(4), 4, 0.0))
    T_cam_obj = look_at_object(0.7, 0.7, 0.7, (0.08, 0.0, -0.05))
    track = tracker.start(stood[0], T_cam_obj=T_cam_obj, extents=SCENE.model.extents)
    for frame in stood[1:]:
        track = tracker.step(track, frame)
    assert track.state is TrackState.TRACKING
    return track


@pytest.fixture(scope="module")
def found(tracker: Tracker, followed: Track) -> list[Track]:
    """After a second without an image it stands 19 cm farther on: all tracks from its find on."""
    tracks, track = [], followed
    for frame in frames(AWAY, 30, 1.1):
        track = tracker.step(track, frame)
        if tracks or track.state is TrackState.RECOVERING:
            tracks.append(track)
    return tracks


def test_after_a_gap_it_is_not_believed_at_once(found: list[Track]) -> None:
    states = [track.state for track in found]
    assert states[: PATIENCE - 1] == [TrackState.RECOVERING] * (PATIENCE - 1)
    assert states[PATIENCE - 1] is TrackState.TRACKING


def test_nothing_is_learned_from_it_before(followed: Track, found: list[Track]) -> None:
    before, last = followed.memory, found[PATIENCE - 2].memory
    assert last.views is before.views
    assert last.canonical is before.canonical
    assert len(last.surface.memory.surface) == len(before.surface.memory.surface)


def test_a_gap_in_the_doubt_begins_it_again(tracker: Tracker, found: list[Track]) -> None:
    track = found[PATIENCE - 2]
    assert track.memory.count.good == PATIENCE - 1
    (frame,) = frames(AWAY, 1, float(track.stamp or 0.0) + 5.0)
    track = tracker.step(track, frame)
    assert track.state is TrackState.RECOVERING
    assert track.memory.count.good == 1


def test_of_where_it_stood_nothing_is_kept(followed: Track, found: list[Track]) -> None:
    (seen,) = found[PATIENCE - 1].memory.place.seen
    assert seen.view.frame.stamp == found[PATIENCE - 1].stamp


def test_at_its_place_it_is_believed_after_the_gap(tracker: Tracker, followed: Track) -> None:
    (frame,) = frames(np.eye(4), 1, 1.1)
    track = tracker.step(followed, frame)
    assert track.state is TrackState.TRACKING
    assert len(track.memory.place.seen) > 1


def test_another_find_begins_the_count_anew(tracker: Tracker, found: list[Track]) -> None:
    """The object jumps on while it is in doubt."""
    track = found[PATIENCE // 2]
    assert track.state is TrackState.RECOVERING
    farther = make_transform(np.eye(3), np.array([-0.2, 0.0, 0.0]))
    good = []
    for frame in frames(farther, 6, float(track.stamp or 0.0) + 1 / 30):
        track = tracker.step(track, frame)
        good.append(track.memory.count.good)
    assert track.state is TrackState.RECOVERING
    assert max(good) <= 6
