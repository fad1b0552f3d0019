"""SIFT with depth: places are right, matches are mutual, the tracker follows and gives up."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from baselines.tabletop_scene import HEIGHT, WIDTH, K, approach, look_at_object, make_tabletop
from robust6dof.baselines.feature_view import find_features
from robust6dof.baselines.features import FeatureTracker
from robust6dof.errors import InputError
from robust6dof.frames import RgbdFrame, TrackState
from robust6dof.geometry.transforms import axis_error, invert_transform, transform_points
from robust6dof.tracking.image_features import FeatureConfig, Features, match

SCENE = make_tabletop("can", 3)
NEAR = look_at_object(0.7, 0.7, 0.6)
FIRST = SCENE.shoot(NEAR, np.random.default_rng(0), 0.0)
EXTENTS = SCENE.model.extents
BLACK = np.zeros((HEIGHT, WIDTH, 3), np.uint8)


def started():
    tracker = FeatureTracker("can")
    return tracker, tracker.start(FIRST.frame, T_cam_obj=FIRST.T_cam_obj, extents=EXTENTS)


def test_features_lie_in_the_box_and_on_the_surface():
    found = find_features(FIRST.frame, FIRST.T_cam_obj, EXTENTS, None, 0.01, FeatureConfig())
    assert len(found) > 10
    points_obj = transform_points(invert_transform(FIRST.T_cam_obj), found.points)
    assert (np.abs(points_obj) < 0.5 * EXTENTS + 0.01).all()
    np.testing.assert_allclose(np.linalg.norm(found.descriptors, axis=1), 1.0, atol=1e-5)


def test_matches_are_mutual_and_clear():
    rng = np.random.default_rng(0)
    descriptors = rng.random((6, 128), dtype=np.float32)
    descriptors /= np.linalg.norm(descriptors, axis=1, keepdims=True)
    descriptors[4] = descriptors[5]  # two alike: neither is clear
    old = Features(rng.random((6, 3)), descriptors, np.zeros((6, 2), int))
    order = np.array([3, 0, 5, 1, 2, 4])
    pairs = match(old, old[order], 0.9)
    assert {tuple(pair) for pair in pairs} == {
        (i, int(np.flatnonzero(order == i)[0])) for i in range(4)
    }
    assert len(match(old[np.arange(1)], old, 0.9)) == 0


def test_follows_a_noisy_flight_around_a_textured_can():
    rng = np.random.default_rng(0)
    tracker, track = None, None
    for stamp, T_cam_world in list(approach(240))[100:140]:
        shot = SCENE.shoot(T_cam_world, rng, stamp)
        if tracker is None or track is None:
            tracker = FeatureTracker("can")
            track = tracker.start(shot.frame, T_cam_obj=shot.T_cam_obj, extents=EXTENTS)
            continue
        track = tracker.step(track, shot.frame)
        tilt = np.degrees(axis_error(track.T_cam_obj[:3, :3], shot.T_cam_obj[:3, :3]))
        gap = np.linalg.norm(track.T_cam_obj[:3, 3] - shot.T_cam_obj[:3, 3])
        assert track.state is TrackState.TRACKING
        assert tilt < 6.0
        assert gap < 0.02


def test_is_lost_when_the_object_is_taken_away_and_holds_its_pose():
    rng = np.random.default_rng(0)
    tracker, track = started()
    bare = replace(SCENE, with_object=False)
    for index in range(1, 6):
        track = tracker.step(track, bare.shoot(NEAR, rng, index / 20).frame)
    assert track.state is TrackState.LOST
    assert np.linalg.norm(track.T_cam_obj[:3, 3] - FIRST.T_cam_obj[:3, 3]) < 0.05


@pytest.mark.parametrize("depth", [0.0, np.nan, np.inf, 0.7])
@pytest.mark.parametrize("has_color", [True, False])
def test_bad_images_never_crash_or_claim_much(depth, has_color):
    tracker, track = started()
    flat = np.full((HEIGHT, WIDTH), depth, np.float32)
    track = tracker.step(track, RgbdFrame(BLACK, flat, K, has_color=has_color))
    assert np.isfinite(track.T_cam_obj).all()
    assert track.confidence < 0.5


def test_a_step_leaves_the_old_track_as_it_was_and_repeats():
    tracker, track = started()
    frame = SCENE.shoot(look_at_object(0.72, 0.7, 0.59), np.random.default_rng(1), 0.05).frame
    first, second = tracker.step(track, frame), tracker.step(track, frame)
    np.testing.assert_array_equal(first.T_cam_obj, second.T_cam_obj)
    assert track.memory.frames == 0


def test_a_start_without_depth_on_the_object_is_refused():
    empty = RgbdFrame(BLACK, np.zeros((HEIGHT, WIDTH), np.float32), K)
    with pytest.raises(InputError, match="no depth on the object"):
        FeatureTracker("can").start(empty, T_cam_obj=FIRST.T_cam_obj, extents=EXTENTS)
