"""Who tells the tracker the wrong category is not told that all is well."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from baselines.tabletop_scene import Shot, look_at_object, make_tabletop
from robust6dof.frames import CATEGORIES, RgbdFrame, Track
from robust6dof.geometry.camera import backproject
from robust6dof.geometry.transforms import invert_transform, make_transform, transform_points
from robust6dof.shapes.priors import load_prior
from robust6dof.tracking.likeness import LARGEST_STRANGENESS, CategoryShape, stands_as_given
from robust6dof.tracking.tracker import Tracker

SHAPES = {name: CategoryShape(load_prior(name), name) for name in CATEGORIES}
EXTENTS = np.array([0.1, 0.2, 0.1])


def shot(category: str, seed: int = 0) -> tuple[Shot, np.ndarray]:
    scene = make_tabletop(category, seed, clutter=0)
    made = scene.shoot(look_at_object(0.7, 0.7, 0.8), np.random.default_rng(0))
    return made, scene.model.extents


def aside(T_cam_obj: np.ndarray, metres: float) -> np.ndarray:
    return make_transform(np.eye(3), np.array([metres, 0.0, 0.0])) @ T_cam_obj


def test_a_surface_is_as_far_from_the_prior_as_it_was_moved() -> None:
    prior = load_prior("can").astype(float)
    low, high = prior.min(axis=0), prior.max(axis=0)
    points = (prior - (low + high) / 2) / (high - low) * EXTENTS
    top = points[points[:, 1] > 0.0999]
    lifted = top + [0.0, 0.05 * np.linalg.norm(EXTENTS), 0.0]
    assert SHAPES["can"].gap(points, EXTENTS) == pytest.approx(0.0, abs=1e-6)
    assert SHAPES["can"].gap(lifted, EXTENTS) == pytest.approx(0.05, abs=1e-3)
    assert SHAPES["can"].gap(3 * lifted, 3 * EXTENTS) == pytest.approx(0.05, abs=1e-3)
    assert SHAPES["can"].gap(points + 9.0, EXTENTS) == pytest.approx(0.1)


def test_what_the_image_shows_behind_the_prior_is_seen_through() -> None:
    made, extents = shot("can")
    shape, T_cam_obj = SHAPES["can"], made.T_cam_obj
    assert shape.seen_through(made.frame, T_cam_obj, extents) < 0.1
    off = aside(T_cam_obj, 0.6 * float(np.linalg.norm(extents)))
    assert shape.seen_through(made.frame, off, extents) > 0.5


def test_what_hides_the_object_and_what_has_no_depth_say_nothing() -> None:
    made, extents = shot("can")
    for depth in (0.3, 0.0, np.nan, np.inf):
        frame = replace(made.frame, depth=np.full_like(made.frame.depth, depth))
        assert SHAPES["can"].seen_through(frame, made.T_cam_obj, extents) == 0.0
    behind = make_transform(np.eye(3), np.array([0.0, 0.0, -3.0])) @ made.T_cam_obj
    assert SHAPES["can"].seen_through(made.frame, behind, extents) == 0.0


@pytest.mark.parametrize("category", CATEGORIES)
def test_things_of_the_category_are_like_it(category: str) -> None:
    for seed in range(4):
        made, extents = shot(category, seed)
        points, _ = backproject(made.frame.depth, made.frame.K, made.mask)
        points = transform_points(invert_transform(made.T_cam_obj), points)
        assert SHAPES[category].likeness(made.frame, made.T_cam_obj, extents, points) > 0.6


def test_other_priors_than_those_of_the_categories_have_no_limit() -> None:
    made, extents = shot("can")
    shape = CategoryShape(load_prior("laptop"), "kettle")
    assert shape.likeness(made.frame, made.T_cam_obj, extents, np.zeros((9, 3))) == 1.0


@pytest.mark.parametrize("told", ["bottle", "camera", "can", "mug"])
def test_a_laptop_told_to_be_another_thing_is_not_believed(told: str) -> None:
    made, _ = shot("laptop")
    for name, sure in (("laptop", True), (told, False)):
        tracker = Tracker.from_pretrained(category=name, device="cpu")
        track = tracker.start(made.frame, mask=made.mask)
        assert (track.confidence >= 0.5) is sure
    assert set(LARGEST_STRANGENESS) == set(CATEGORIES)


@pytest.mark.parametrize(
    ("axis", "degrees", "metres", "symmetric", "stands"),
    [
        ("z", 9.0, 0.04, False, True),
        ("z", 11.0, 0.0, False, False),
        ("y", 11.0, 0.0, False, False),
        ("y", 120.0, 0.0, True, True),
        ("z", 11.0, 0.0, True, False),
        ("z", 0.0, 0.06, True, False),
    ],
)
def test_a_frame_stands_as_given_within_10_degrees_and_5_cm(
    axis: str, degrees: float, metres: float, symmetric: bool, stands: bool
) -> None:
    turn = Rotation.from_euler(axis, degrees, degrees=True).as_matrix()
    given = make_transform(Rotation.from_euler("xyz", [1, 2, 3]).as_matrix(), np.ones(3))
    T_model_obj = given @ make_transform(turn, np.array([0.0, metres, 0.0]))
    assert stands_as_given(T_model_obj, given, symmetric) is stands


def test_a_given_pose_is_doubted_only_where_the_network_has_left_it() -> None:
    made, extents = shot("laptop")
    tracker = Tracker.from_pretrained(category="can", device="cpu")
    track = tracker.start(made.frame, T_cam_obj=made.T_cam_obj, extents=extents)
    assert track.memory.T_model_given is not None
    given = track.T_cam_obj @ track.memory.T_model_given
    np.testing.assert_allclose(given, made.T_cam_obj, atol=1e-9)
    here = np.eye(4)
    shifted = make_transform(np.eye(3), np.array([0.0, 0.2, 0.0]))
    stays, left, estimated = (
        tracker._likeness(made.frame, replace(track.memory, T_model_given=T_model_given))
        for T_model_given in (here, shifted, None)
    )
    assert stays == 1.0
    assert left == estimated < 0.5


def test_what_looks_strange_is_followed_and_found_again_and_never_believed() -> None:
    scene = make_tabletop("laptop", 0, clutter=0)
    tracker = Tracker.from_pretrained(category="can", device="cpu")
    tracks: list[Track] = []
    for index in range(12):
        T_cam_world = look_at_object(0.7 + 0.01 * index, 0.7, 0.8)
        made = scene.shoot(T_cam_world, np.random.default_rng(index), stamp=index / 30)
        frame = dark(made.frame) if 4 <= index < 8 else made.frame
        first = not tracks
        track = tracker.start(frame, mask=made.mask) if first else tracker.step(tracks[-1], frame)
        tracks.append(track)
    states = [track.state.value for track in tracks]
    assert states[:4] == ["tracking"] * 4
    assert states[7] == "lost"
    assert tracks[7].confidence == 0.0
    assert states[8:] == ["recovering", "recovering", "tracking", "tracking"]
    assert max(track.confidence for track in tracks) < 0.5


def dark(frame: RgbdFrame) -> RgbdFrame:
    """No light and no depth."""
    return replace(frame, rgb=np.zeros_like(frame.rgb), depth=np.zeros_like(frame.depth))


def test_no_surface_and_points_that_are_none_are_not_strange() -> None:
    made, extents = shot("can")
    for points in (np.zeros((0, 3)), np.full((9, 3), np.nan)):
        assert SHAPES["can"].likeness(made.frame, made.T_cam_obj, extents, points) > 0.9
