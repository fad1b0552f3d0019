"""Things stand on what carries them, apart from one another, and move with it."""

import itertools
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from robust6dof.geometry.transforms import invert_transform, transform_points
from robust6dof.rendering.d435i import color_camera
from robust6dof.rendering.rasteriser import render
from robust6dof.shapes.procedural import make_object
from robust6dof.synthetic.aerial_world import CARRIED_ID, TARGET_ID, AerialWorld
from robust6dof.synthetic.camera_motion import CameraMotion
from robust6dof.synthetic.difficulty import DIFFICULTIES
from robust6dof.synthetic.sequence import SyntheticSequence

CATEGORIES = ("laptop", "mug", "bottle")


@cache
def drawn(seed: int, moves: bool) -> AerialWorld:
    rng = np.random.default_rng(seed)
    bounds = replace(DIFFICULTIES["harsh"], moving_share=float(moves))
    return AerialWorld.draw(rng, make_object(CATEGORIES[seed % 3], rng), bounds, 4.0)


@pytest.mark.parametrize("moves", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_all_stand_on_the_support_apart_from_one_another(seed: int, moves: bool) -> None:
    world = drawn(seed, moves)
    surface = world.support.surface
    standing = [world.target, *world.others]
    for thing in standing:
        points = transform_points(thing.T_world_obj, thing.model.mesh.vertices)
        assert points[:, 2].min() == pytest.approx(surface.top, abs=1e-6)
        assert surface.covers(thing.T_world_obj[None, :3, 3]).all()
    for one, other in itertools.combinations(standing, 2):
        gap = np.linalg.norm(one.T_world_obj[:2, 3] - other.T_world_obj[:2, 3])
        assert gap > one.footprint + other.footprint


def test_what_a_cart_carries_moves_as_one() -> None:
    world = drawn(0, moves=True)
    before, after = (world.scene(t).instances for t in (0.0, 3.5))
    T_target_before, T_target_after = before[0].T_world_mesh, after[0].T_world_mesh
    assert np.linalg.norm(T_target_after[:3, 3] - T_target_before[:3, 3]) > 0.3
    for a, b in zip(before, after, strict=True):
        if a.instance_id in (TARGET_ID, CARRIED_ID):
            seen_before = invert_transform(T_target_before) @ a.T_world_mesh
            seen_after = invert_transform(T_target_after) @ b.T_world_mesh
            np.testing.assert_allclose(seen_before, seen_after, atol=1e-9)
        else:
            np.testing.assert_array_equal(a.T_world_mesh, b.T_world_mesh)


def test_the_room_closes_the_view() -> None:
    """Wherever the camera looks while it flies, there is something to see."""
    for seed in range(2):
        world = drawn(seed, moves=bool(seed))
        motion = CameraMotion.draw(np.random.default_rng(seed), DIFFICULTIES["harsh"], 4.0)
        for t in np.linspace(0, 4, 5):
            T_world_cam = motion.T_world_cam(t, world.T_world_obj(t)[:3, 3])
            rendering = render(world.scene(t), color_camera(T_world_cam, scale=0.1))
            assert (rendering.depth > 0).mean() > 0.97
            assert rendering.depth.max() < 12.0


def test_user_objects_are_the_distractors_of_their_own_category() -> None:
    alike = [make_object("mug", seed) for seed in (5, 6)]
    teapots = [type(m)(m.mesh, "teapot", f"teapot_{i}", {}) for i, m in enumerate(alike)]
    sequence = SyntheticSequence.draw(teapots[0], "harsh", 4, 3, alike=teapots)
    like = [o for o in sequence.world.others if o.model.category == "teapot"]
    assert 1 <= len(like) <= 2
    assert all(any(o.model is teapot for teapot in teapots) for o in like)
