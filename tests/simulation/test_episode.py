"""Drawn scenes and starts keep to what the scenario allows, and repeat."""

import numpy as np
import pytest

from robust6dof.errors import InputError
from robust6dof.frames import CATEGORIES
from robust6dof.geometry.transforms import invert_transform
from robust6dof.rendering.d435i import color_camera
from robust6dof.rendering.rasteriser import render_depth
from robust6dof.robot.aerial_manipulator import default_aerial_manipulator
from robust6dof.servo.goal import look_down_goal
from robust6dof.simulation.episode import TARGET_ID, EpisodeOptions, draw_world, goal_camera
from robust6dof.simulation.scenario import SCENARIOS, scenario_named
from robust6dof.simulation.start import draw_episode

MANIPULATOR = default_aerial_manipulator()
GOAL = look_down_goal(0.5)


def drawn(seed, scenario="table", category="mug"):
    options = EpisodeOptions(category)
    return draw_episode(scenario_named(scenario), options, MANIPULATOR, GOAL, seed)


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_starts_are_where_the_method_says(seed):
    episode = drawn(seed)
    T_world_cam = episode.T_world_body @ MANIPULATOR.T_body_cam(episode.joints)
    T_world_goal = goal_camera(episode.world, GOAL)
    distance = np.linalg.norm(T_world_cam[:3, 3] - T_world_goal[:3, 3])
    angle = np.degrees(np.arccos(T_world_cam[:3, 2] @ T_world_goal[:3, 2]))
    assert 0.5 <= distance <= 1.5
    assert 20 <= angle <= 60
    np.testing.assert_allclose(episode.T_world_body[2, :3], [0, 0, 1], atol=1e-9)  # level
    assert MANIPULATOR.within_limits(episode.joints)
    _, ids = render_depth(episode.world.scene(0.0), color_camera(T_world_cam))
    assert (ids == TARGET_ID).sum() > 600


def test_the_same_seed_draws_the_same_and_another_another():
    first, again, other = drawn(5), drawn(5), drawn(6)
    assert (first.T_world_body == again.T_world_body).all()
    assert (first.world.target.mesh.texture == again.world.target.mesh.texture).all()
    assert (first.world.target.mesh.vertices == again.world.target.mesh.vertices).all()
    assert (first.T_world_body != other.T_world_body).any()


def test_objects_stand_on_the_table_and_do_not_touch():
    world = draw_world(scenario_named("table"), EpisodeOptions("can"), 3)
    top = world.support.surface.top
    thing = world.target.mesh.vertices @ world.T_world_obj(0.0)[:3, :3].T
    assert abs(thing[:, 2].min() + world.T_world_obj(0.0)[2, 3] - top) < 1e-9
    assert len(world.clutter) >= 1
    for other in world.clutter:
        apart = other.T_world_mesh[:2, 3] - world.T_world_obj(0.0)[:2, 3]
        assert np.linalg.norm(apart) > 0.05
        lowest = (other.mesh.vertices @ other.T_world_mesh[:3, :3].T)[:, 2].min()
        assert abs(lowest + other.T_world_mesh[2, 3] - top) < 1e-9


def test_the_category_is_drawn_unless_named():
    scenario = scenario_named("moving")  # no clutter: quick
    names = {draw_world(scenario, EpisodeOptions(), seed).target.category for seed in range(12)}
    assert len(names) > 2
    assert names <= set(CATEGORIES)


def test_the_goal_camera_looks_straight_down_on_the_object():
    world = draw_world(scenario_named("moving"), EpisodeOptions("bowl"), 0)
    T_world_cam = goal_camera(world, GOAL)
    np.testing.assert_allclose(T_world_cam[:3, 2], [0, 0, -1], atol=1e-12)
    t_cam_obj = (invert_transform(T_world_cam) @ world.T_world_obj(0.0))[:3, 3]
    np.testing.assert_allclose(t_cam_obj, [0, 0, 0.5], atol=1e-12)


@pytest.mark.parametrize("name", SCENARIOS)
def test_every_scenario_draws_a_start(name):
    episode = drawn(1, scenario=name, category="can")
    assert episode.scenario.name == name


def test_an_unknown_scenario_names_those_there_are():
    with pytest.raises(InputError, match="leave-and-return"):
        scenario_named("tabel")
