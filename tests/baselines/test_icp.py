"""The ICP tracker follows what it should, admits when it cannot, and survives bad images."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from baselines.tabletop_scene import (
    HEIGHT,
    WIDTH,
    K,
    Shot,
    approach,
    look_at_object,
    make_tabletop,
)
from robust6dof.errors import InputError
from robust6dof.frames import RgbdFrame, Track, TrackState
from robust6dof.geometry.transforms import axis_error, make_transform, rotation_error
from robust6dof.tracking.surface.icp import IcpTracker

NEAR = look_at_object(0.7, 0.7, 0.7)


def start_on(shot: Shot, extents: np.ndarray, category: str = "mug") -> tuple[IcpTracker, Track]:
    tracker = IcpTracker(category)
    track = tracker.start(shot.frame, T_cam_obj=shot.T_cam_obj, extents=extents)
    return tracker, track


def errors(track: Track, shot: Shot, symmetric: bool) -> tuple[float, float]:
    """Rotation [deg] and translation [cm]."""
    compare = axis_error if symmetric else rotation_error
    angle = compare(track.T_cam_obj[:3, :3], shot.T_cam_obj[:3, :3])
    gap = np.linalg.norm(track.T_cam_obj[:3, 3] - shot.T_cam_obj[:3, 3])
    return float(np.degrees(angle)), 100.0 * float(gap)


@pytest.mark.parametrize(("category", "symmetric"), [("mug", False), ("can", True)])
def test_follows_a_noise_free_flight_closely(category: str, symmetric: bool) -> None:
    scene, rng = make_tabletop(category, 0, noisy=False), np.random.default_rng(0)
    flight = list(approach(120))[20:60]
    shots = [scene.shoot(T_cam_world, rng, stamp) for stamp, T_cam_world in flight]
    tracker, track = start_on(shots[0], scene.model.extents, category)
    for shot in shots[1:]:
        track = tracker.step(track, shot.frame)
        angle, gap = errors(track, shot, symmetric)
        assert track.state is TrackState.TRACKING
        assert angle < 2.0
        assert gap < 0.4


@pytest.mark.parametrize("use_color", [True, False])
def test_follows_a_noisy_flight(use_color: bool) -> None:
    scene, rng = make_tabletop("mug", 0), np.random.default_rng(0)
    tracker, track, worst = None, None, 0.0
    for stamp, T_cam_world in list(approach(240))[:60]:
        shot = scene.shoot(T_cam_world, rng, stamp)
        if not use_color:
            shot = replace(shot, frame=replace(shot.frame, has_color=False))
        if tracker is None or track is None:
            tracker, track = start_on(shot, scene.model.extents)
            continue
        track = tracker.step(track, shot.frame)
        axis, gap = errors(track, shot, symmetric=True)
        worst = max(worst, gap)
        assert axis < 4.0
    assert worst < 2.0


def test_follows_an_object_that_is_lifted_from_its_surroundings() -> None:
    scene, rng = make_tabletop("mug", 0, noisy=False), np.random.default_rng(0)
    tracker, track, shot, forgotten = None, None, None, False
    for index in range(40):
        T_world_obj = make_transform(np.eye(3), np.array([0.0, 0.004 * max(0, index - 3), 0.0]))
        shot = scene.shoot_object_at(T_world_obj, NEAR, rng, index / 20)
        if tracker is None or track is None:
            tracker, track = start_on(shot, scene.model.extents)
            assert track.memory.surroundings is not None
        else:
            track = tracker.step(track, shot.frame)
            forgotten = forgotten or track.memory.surroundings is None
    assert track is not None
    assert shot is not None
    assert forgotten
    angle, gap = errors(track, shot, symmetric=False)
    assert angle < 2.0
    assert gap < 0.5


def test_is_lost_soon_after_the_object_is_taken_away_and_holds_its_pose() -> None:
    scene, rng = make_tabletop("mug", 0), np.random.default_rng(0)
    tracker, track = start_on(scene.shoot(NEAR, rng, 0.0), scene.model.extents)
    for index in range(1, 4):
        track = tracker.step(track, scene.shoot(NEAR, rng, index / 20).frame)
    assert track.state is TrackState.TRACKING
    last = track.T_cam_obj
    bare = replace(scene, with_object=False)
    for index in range(4, 9):
        track = tracker.step(track, bare.shoot(NEAR, rng, index / 20).frame)
    assert track.state is TrackState.LOST
    assert track.confidence < 0.2
    assert np.linalg.norm(track.T_cam_obj[:3, 3] - last[:3, 3]) < 0.05


def test_is_lost_out_of_view_and_recovers_in_view() -> None:
    scene, rng = make_tabletop("mug", 0), np.random.default_rng(0)
    tracker, track = start_on(scene.shoot(NEAR, rng, 0.0), scene.model.extents)
    away = look_at_object(0.7, 0.7, 0.7, aim=[2.0, 0.3, -1.7])
    states = []
    for index in range(1, 12):
        T_cam_world = away if 3 <= index < 7 else NEAR
        track = tracker.step(track, scene.shoot(T_cam_world, rng, index / 20).frame)
        states.append(track.state)
    assert states[5] is TrackState.LOST
    assert TrackState.RECOVERING in states
    assert states[-1] is TrackState.TRACKING


def test_a_step_leaves_the_old_track_as_it_was() -> None:
    scene, rng = make_tabletop("mug", 0), np.random.default_rng(0)
    tracker, track = start_on(scene.shoot(NEAR, rng, 0.0), scene.model.extents)
    frame = scene.shoot(look_at_object(0.72, 0.7, 0.69), rng, 0.05).frame
    first, second = tracker.step(track, frame), tracker.step(track, frame)
    np.testing.assert_array_equal(first.T_cam_obj, second.T_cam_obj)
    assert len(track.memory.surface) < len(first.memory.surface)


BLACK = np.zeros((HEIGHT, WIDTH, 3), np.uint8)


def degenerate_depth(kind: str, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    depth = np.zeros((HEIGHT, WIDTH), np.float32)
    if kind == "nan":
        depth[:] = np.nan
    elif kind == "infinite":
        depth[:] = np.inf
    elif kind == "pixel":
        depth[rng.integers(HEIGHT), rng.integers(WIDTH)] = rng.uniform(0.1, 2.0)
    elif kind == "noise":
        depth[:] = rng.uniform(-1.0, 3.0, depth.shape)
    elif kind == "wall":
        depth[:] = rng.uniform(0.1, 2.0)
    elif kind == "sparse":
        chosen = rng.random(depth.shape) < 0.001
        depth[chosen] = rng.uniform(0.4, 1.0, chosen.sum())
    return depth


SCENE = make_tabletop("mug", 0)
FIRST = SCENE.shoot(NEAR, np.random.default_rng(0), 0.0)


@settings(max_examples=20, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(
    kinds=st.lists(
        st.sampled_from(["zero", "nan", "infinite", "pixel", "noise", "wall", "sparse", "good"]),
        min_size=1,
        max_size=5,
    ),
    seed=st.integers(0, 1000),
    stamped=st.booleans(),
)
def test_bad_images_never_crash_or_claim_much(kinds: list[str], seed: int, stamped: bool) -> None:
    tracker, track = start_on(FIRST, SCENE.model.extents)
    for index, kind in enumerate(kinds, start=1):
        stamp = index / 20 if stamped else None
        if kind == "good":
            frame = replace(FIRST.frame, stamp=stamp)
        else:
            frame = RgbdFrame(BLACK, degenerate_depth(kind, seed + index), K, stamp=stamp)
        track = tracker.step(track, frame)
        assert np.isfinite(track.T_cam_obj).all()
        assert np.isfinite(track.extents).all()
        assert 0.0 <= track.confidence <= 1.0
        if kind != "good":
            assert track.confidence < 0.3
            assert track.state is not TrackState.TRACKING


def test_a_start_without_depth_on_the_object_is_refused() -> None:
    empty = RgbdFrame(BLACK, np.zeros((HEIGHT, WIDTH), np.float32), K)
    with pytest.raises(InputError, match="no depth on the object"):
        IcpTracker("mug").start(empty, T_cam_obj=FIRST.T_cam_obj, extents=SCENE.model.extents)
