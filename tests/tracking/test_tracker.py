"""The tracker's bookkeeping: memory of views, states, and that bad images never break it."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from robust6dof.errors import InputError
from robust6dof.frames import RgbdFrame, Track, TrackState
from robust6dof.geometry.transforms import make_transform
from robust6dof.network.config import preset
from robust6dof.network.inputs import ViewFeatures
from robust6dof.network.robust6dof_net import Robust6DofNet
from robust6dof.tracking.encoder import ViewEncoder
from robust6dof.tracking.keyframes import Keyframe, KeyframeMemory
from robust6dof.tracking.keypoint_tracker import KeypointTracker
from robust6dof.tracking.states import StateCount, StateRules, next_state
from robust6dof.tracking.tracker import Tracker

K = np.array([[150.0, 0, 80], [0, 150.0, 60], [0, 0, 1]])
START = make_transform(
    Rotation.from_euler("x", 200, degrees=True).as_matrix(), np.array([0, 0, 0.6])
)
EXTENTS = np.array([0.12, 0.1, 0.08])


@pytest.fixture(scope="module", params=[Tracker, KeypointTracker])
def tracker(request: pytest.FixtureRequest) -> Tracker | KeypointTracker:
    torch.manual_seed(0)
    prior = np.random.default_rng(0).uniform(-0.4, 0.4, (200, 3)).astype(np.float32)
    return request.param(ViewEncoder(Robust6DofNet(preset("tiny")), prior, "mug"))


@pytest.fixture(scope="module")
def started(tracker: Tracker | KeypointTracker) -> Track:
    return tracker.start(bump(), T_cam_obj=START, extents=EXTENTS)


def bump(seed: int = 0) -> RgbdFrame:
    """A ball on a plane."""
    y, x = np.mgrid[0:120, 0:160]
    depth = np.minimum(0.65, 0.6 - 0.04 + ((x - 80) ** 2 + (y - 60) ** 2) / 4000)
    rgb = np.random.default_rng(seed).integers(0, 255, (120, 160, 3)).astype(np.uint8)
    return RgbdFrame(rgb, depth.astype(np.float32), K, stamp=0.0)


def spoiled(kind: str, seed: int) -> RgbdFrame:
    rng = np.random.default_rng(seed)
    frame = bump(seed)
    depth = frame.depth.copy()
    if kind == "no depth":
        depth[:] = 0
    elif kind == "all NaN":
        depth[:] = np.nan
    elif kind == "one pixel":
        depth[:] = 0
        depth[60, 80] = 0.6
    elif kind == "noise":
        depth = rng.uniform(0, 3, depth.shape).astype(np.float32)
    elif kind == "infinite":
        depth[rng.random(depth.shape) < 0.3] = np.inf
    elif kind == "object fills the view":
        depth[:] = rng.uniform(0.05, 0.6)
    return replace(frame, depth=depth, stamp=float(rng.uniform(-1, 5)))


KINDS = ["no depth", "all NaN", "one pixel", "noise", "infinite", "object fills the view", "fine"]


@given(st.lists(st.tuples(st.sampled_from(KINDS), st.integers(0, 99)), min_size=1, max_size=6))
@settings(max_examples=15, deadline=None)
def test_bad_images_never_break_the_track(
    tracker: Tracker | KeypointTracker, started: Track, kinds: list[tuple[str, int]]
) -> None:
    track = started
    for kind, seed in kinds:
        track = tracker.step(track, spoiled(kind, seed))
        assert np.isfinite(track.T_cam_obj).all()
        assert np.linalg.det(track.T_cam_obj[:3, :3]) == pytest.approx(1.0, abs=1e-6)
        assert np.isfinite(track.extents).all()
        assert 0.0 <= track.confidence <= 1.0
        if kind in ("no depth", "all NaN", "one pixel"):
            assert track.confidence == 0.0


def test_without_depth_it_is_lost_and_holds_its_pose(tracker: Tracker | KeypointTracker) -> None:
    track = tracker.start(bump(), T_cam_obj=START, extents=EXTENTS)
    held = track.T_cam_obj
    for _ in range(4):
        track = tracker.step(track, spoiled("no depth", 0))
    assert track.state is TrackState.LOST
    np.testing.assert_allclose(track.T_cam_obj, held, atol=1e-12)


def test_the_same_frames_give_the_same_track(tracker: Tracker | KeypointTracker) -> None:
    def run() -> np.ndarray:
        track = tracker.start(bump(), T_cam_obj=START, extents=EXTENTS)
        for seed in range(3):
            track = tracker.step(track, bump(seed))
        return track.T_cam_obj

    np.testing.assert_array_equal(run(), run())


def test_a_start_without_depth_says_so(tracker: Tracker | KeypointTracker) -> None:
    with pytest.raises(InputError, match="no depth on the object"):
        tracker.start(spoiled("no depth", 0), T_cam_obj=START, extents=EXTENTS)


def keyframe(azimuth_deg: float, confidence: float = 0.9) -> Keyframe:
    """Seen from an azimuth about the object's y axis."""
    R = Rotation.from_euler("y", -azimuth_deg, degrees=True).as_matrix()
    empty = torch.zeros(1, 1, 3)
    names = ViewFeatures.__dataclass_fields__
    features = object.__new__(ViewFeatures)
    for name in names:
        object.__setattr__(features, name, empty)
    return Keyframe(features, make_transform(R, np.array([0, 0, 1.0])), confidence)


def test_memory_spreads_over_viewpoints_and_keeps_the_first() -> None:
    first = keyframe(0, 0.1)
    memory = KeyframeMemory((first,), capacity=5)
    for azimuth in range(0, 360, 3):
        memory = memory.with_view(keyframe(azimuth))
    assert len(memory.keyframes) == 5
    assert memory.keyframes[0] is first
    directions = np.stack([k.view_direction for k in memory.keyframes])
    closest = (directions @ directions.T - 2 * np.eye(5)).max()
    assert closest < np.cos(memory.spacing) + 1e-9
    near = memory.nearest(memory.keyframes[2].T_cam_obj, 2)
    assert near[0] is memory.keyframes[2]


def test_a_better_view_replaces_its_like() -> None:
    memory = KeyframeMemory((keyframe(0), keyframe(90, 0.5)))
    better, worse = keyframe(95, 0.8), keyframe(95, 0.52)
    assert memory.with_view(worse) is memory
    assert memory.with_view(better).keyframes[1] is better


def test_states_follow_the_documented_transitions() -> None:
    rules, state, count = StateRules(), TrackState.TRACKING, StateCount()
    seen = []
    for confidence in (0.9, 0.4, 0.1, 0.1, 0.1, 0.4, 0.6, 0.1, 0.7, 0.7, 0.7):
        count = count.after(confidence, rules)
        state = next_state(state, count, rules)
        seen.append(state.value)
    assert seen == [
        *["tracking", "uncertain", "uncertain", "uncertain", "lost", "lost"],
        *["recovering", "lost", "recovering", "recovering", "tracking"],
    ]


def test_what_is_found_elsewhere_than_where_it_stood_is_doubted_for_longer() -> None:
    rules = StateRules()

    def frames_until_tracking(stands: bool) -> int:
        state, count, frames = TrackState.LOST, StateCount(), 0
        while state is not TrackState.TRACKING:
            count, frames = count.after(0.9, rules), frames + 1
            state = next_state(state, count, rules, stands)
        return frames

    assert frames_until_tracking(stands=True) == rules.patience
    assert frames_until_tracking(stands=False) == rules.unplaced_patience


def test_doubt_ends_after_three_good_frames() -> None:
    rules, state, count = StateRules(), TrackState.TRACKING, StateCount()
    seen = []
    for confidence in (0.4, 0.6, 0.4, 0.6, 0.6, 0.6):
        count = count.after(confidence, rules)
        state = next_state(state, count, rules)
        seen.append(state.value)
    assert seen == [*["uncertain"] * 5, "tracking"]
