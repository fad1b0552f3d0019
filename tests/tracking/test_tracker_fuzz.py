"""With the shipped weights, no image breaks a track that was good, and none is taken for more than
it shows."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from jaxtyping import TypeCheckError

from robust6dof.errors import InputError
from robust6dof.frames import RgbdFrame, Track, TrackState
from robust6dof.tracking.several import SeveralTrackers
from robust6dof.tracking.states import StateRules
from robust6dof.tracking.tracker import Tracker
from tracking.bad_images import BLIND, CLOCKS, SPOILED, Flight

PATIENCE = StateRules().patience
CREWS = {
    "mug": (Flight("mug", 0), ("mug",)),
    "can": (Flight("can", 1), ("can",)),
    "laptop": (Flight("laptop", 2), ("laptop",)),
    "two": (Flight("mug", 0), ("mug", "bowl")),
}
"""What is in view, and the categories of those that track it: `two` has one that is wrong."""
KINDS = ("good", "away", "bare", "another", *BLIND, *SPOILED)


@dataclass(frozen=True)
class Episode:
    """So many frames of a kind."""

    kind: str
    frames: int
    clock: str
    seed: int


EPISODES = st.builds(
    Episode,
    kind=st.sampled_from(KINDS),
    frames=st.integers(1, 6),
    clock=st.sampled_from(["runs"] * 6 + list(CLOCKS)),
    seed=st.integers(0, 10_000),
)


@cache
def tracker_of(category: str) -> Tracker:
    return Tracker.from_pretrained(category=category, device="cpu")


@cache
def good_start(crew: str) -> tuple[Track, ...]:
    """Tracks of an object that was really followed for some frames."""
    flight, categories = CREWS[crew]
    several = SeveralTrackers([tracker_of(category) for category in categories])
    first = replace(flight.good(0), stamp=0.0)
    extents = flight.scene.model.extents
    starts = [
        tracker.start(first, T_cam_obj=flight.first_T_cam_obj, extents=extents)
        for tracker in several.trackers
    ]
    tracks = tuple(starts)
    for index in range(1, 5):
        tracks = several.step(tracks, replace(flight.good(index), stamp=index / 30))
    assert tracks[0].state is TrackState.TRACKING
    assert tracks[0].confidence > 0.5
    return tracks


def frame_of(crew: str, episode: Episode, index: int, stamp: float | None) -> RgbdFrame:
    flight, rng = CREWS[crew][0], np.random.default_rng([episode.seed, index])
    if episode.kind == "away":
        frame = flight.away(index)
    elif episode.kind == "bare":
        frame = flight.bare(index)
    elif episode.kind == "another":
        frame = CREWS["can" if crew != "can" else "mug"][0].good(index)
    else:
        frame = flight.good(index)
    spoil = (BLIND | SPOILED).get(episode.kind)
    return replace(frame if spoil is None else spoil(frame, rng), stamp=stamp)


def check_sound(track: Track) -> None:
    T_cam_obj = track.T_cam_obj
    assert np.isfinite(T_cam_obj).all()
    np.testing.assert_allclose(T_cam_obj[:3, :3] @ T_cam_obj[:3, :3].T, np.eye(3), atol=1e-6)
    assert np.linalg.det(T_cam_obj[:3, :3]) > 0
    np.testing.assert_array_equal(T_cam_obj[3], [0, 0, 0, 1])
    assert np.isfinite(track.extents).all()
    assert (track.extents > 0).all()
    assert 0.0 <= track.confidence <= 1.0


def play(crew: str, episodes: list[Episode]) -> int:
    """Step through all episodes and check every track; how many frames that were."""
    several = SeveralTrackers([tracker_of(category) for category in CREWS[crew][1]])
    tracks, index, clock, unseen, out_of_view = good_start(crew), 4, 4 / 30, 0, 0
    for episode in episodes:
        for _ in range(episode.frames):
            index += 1
            rng = np.random.default_rng([episode.seed, index, 1])
            stamp = CLOCKS[episode.clock](clock, rng)
            clock = stamp if stamp is not None and np.isfinite(stamp) else clock
            tracks = several.step(tracks, frame_of(crew, episode, index, stamp))
            unseen = unseen + 1 if episode.kind in BLIND else 0
            gone = unseen or episode.kind == "away"
            out_of_view = out_of_view + 1 if gone else 0
            for track in tracks:
                check_sound(track)
                if unseen or out_of_view >= PATIENCE:
                    assert track.confidence < 0.5, f"{episode}: sure of what is not in view"
                if out_of_view >= PATIENCE:
                    assert track.state is not TrackState.TRACKING
                if unseen >= PATIENCE:
                    assert track.state is TrackState.LOST
    return index - 4


MANY = 150
COMMON: dict[str, Any] = {
    "deadline": None,
    "derandomize": True,
    "suppress_health_check": [HealthCheck.too_slow, HealthCheck.data_too_large],
}


@given(st.lists(EPISODES, min_size=2, max_size=3))
@settings(max_examples=3, phases=[Phase.generate], **COMMON)
def test_bad_images_never_break_a_track(episodes: list[Episode]) -> None:
    play("mug", episodes)


@pytest.mark.slow
@pytest.mark.timeout(3600)
def test_thousands_of_bad_images_never_break_a_track() -> None:
    frames = 0

    @given(st.sampled_from(list(CREWS)), st.lists(EPISODES, min_size=1, max_size=8))
    @settings(max_examples=MANY, **COMMON)
    def play_some(crew: str, episodes: list[Episode]) -> None:
        nonlocal frames
        frames += play(crew, episodes)

    play_some()
    assert frames > 2000


@pytest.mark.parametrize("kind", ["no depth", "all NaN", "one pixel"])
def test_what_shows_nothing_is_lost_in_time(kind: str) -> None:
    play("mug", [Episode(kind, PATIENCE, "runs", 0), Episode("good", 1, "runs", 0)])


def test_out_of_view_it_is_lost_and_then_found() -> None:
    play("mug", [Episode("away", 6, "runs", 0), Episode("good", 2, "runs", 0)])


def test_depth_of_another_size_is_refused() -> None:
    frame = CREWS["mug"][0].good(0)
    with pytest.raises((InputError, TypeCheckError)):
        replace(frame, depth=frame.depth[::2, ::2])
