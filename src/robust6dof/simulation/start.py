"""Where a run begins: a level vehicle whose camera sees the object from aside."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from robust6dof.errors import InputError
from robust6dof.geometry.transforms import invert_transform, make_transform
from robust6dof.rendering.d435i import color_camera
from robust6dof.rendering.rasteriser import render_depth
from robust6dof.rendering.scene import Camera, Scene
from robust6dof.robot.aerial_manipulator import AerialManipulator
from robust6dof.simulation.episode import (
    TARGET_ID,
    VEHICLE_ID,
    Episode,
    EpisodeOptions,
    World,
    draw_world,
    goal_camera,
)
from robust6dof.simulation.scenario import Scenario, StartRange
from robust6dof.simulation.vehicle import QuadrotorParameters
from robust6dof.simulation.vehicle_look import VehicleLook

_JOINT_MARGIN = 0.15
"""Starts keep this far from the joints' limits [rad]."""

_CLEARANCE = 0.15
"""Of every part of the vehicle above the table, and of the rotors from walls [m]."""

_ATTEMPTS = 4000


@dataclass(frozen=True, eq=False)
class _Candidate:
    T_world_body: Float[np.ndarray, "4 4"]
    joints: Float[np.ndarray, "4"]
    T_world_cam: Float[np.ndarray, "4 4"]


def draw_episode(
    scenario: Scenario,
    options: EpisodeOptions,
    manipulator: AerialManipulator,
    T_cam_obj_goal: Float[np.ndarray, "4 4"],
    seed: int,
) -> Episode:
    """Draw everything of one seed.

    Raises:
        InputError: an unknown category; or no start of the scenario's kind exists for this arm,
            goal and object.
    """
    world = draw_world(scenario, options, seed)
    rng = np.random.default_rng([seed, 2])
    look = VehicleLook.build(manipulator, QuadrotorParameters())
    for _ in range(_ATTEMPTS):
        candidate = _draw(world, manipulator, T_cam_obj_goal, scenario.start, rng)
        if candidate is None or not _is_clear(candidate, world, manipulator):
            continue
        if _visible_share(candidate, world, look) >= scenario.start.min_visible:
            return Episode(scenario, seed, world, candidate.T_world_body, candidate.joints)
    raise InputError(
        f"seed {seed}: no start found with the camera {scenario.start.distance} m from the goal "
        "and the object in view; choose another stand-off or goal"
    )


def _draw(
    world: World,
    manipulator: AerialManipulator,
    T_cam_obj_goal: Float[np.ndarray, "4 4"],
    start: StartRange,
    rng: np.random.Generator,
) -> _Candidate | None:
    """A random posture; the vehicle is then put where the object falls on a random pixel."""
    arm = manipulator.arm
    joints = rng.uniform(arm.lower + _JOINT_MARGIN, arm.upper - _JOINT_MARGIN)
    R_world_body = Rotation.from_euler("z", rng.uniform(-np.pi, np.pi)).as_matrix()
    T_body_cam = manipulator.T_body_cam(joints)
    R_world_cam = R_world_body @ T_body_cam[:3, :3]
    T_world_goal = goal_camera(world, T_cam_obj_goal)
    angle = np.arccos(np.clip(R_world_cam[:, 2] @ T_world_goal[:3, 2], -1.0, 1.0))
    low, high = start.view_angle
    ray = _draw_ray(start.image_margin, rng)
    camera = world.T_world_obj(0.0)[:3, 3] - R_world_cam @ (ray * rng.uniform(0.4, 2.0))
    distance = np.linalg.norm(camera - T_world_goal[:3, 3])
    if not (low <= angle <= high and start.distance[0] <= distance <= start.distance[1]):
        return None
    T_world_cam = make_transform(R_world_cam, camera)
    return _Candidate(T_world_cam @ invert_transform(T_body_cam), joints, T_world_cam)


def _draw_ray(margin: float, rng: np.random.Generator) -> Float[np.ndarray, "3"]:
    camera = color_camera(np.eye(4))
    size = np.array([camera.width, camera.height])
    pixel = rng.uniform(margin * size, (1.0 - margin) * size)
    return np.linalg.inv(camera.K) @ np.array([*pixel, 1.0])


def _is_clear(candidate: _Candidate, world: World, manipulator: AerialManipulator) -> bool:
    """Whether everything hangs above the support and inside the room."""
    T_world_links = candidate.T_world_body @ manipulator.T_body_links(candidate.joints)
    heights = [*T_world_links[:, 2, 3], candidate.T_world_cam[2, 3]]
    lowest = world.support.surface.top + world.target.extents[1] + _CLEARANCE
    reach = world.half_width - 0.4 - _CLEARANCE
    inside = np.abs(candidate.T_world_body[:2, 3]).max() < reach
    return bool(min(heights) > lowest and inside)


def _visible_share(candidate: _Candidate, world: World, look: VehicleLook) -> float:
    """Share of the object's own silhouette that is seen in the full scene."""
    vehicle = look.instances(candidate.T_world_body, candidate.joints, VEHICLE_ID)
    scene = world.scene(0.0, *vehicle)
    camera = color_camera(candidate.T_world_cam, scale=0.5)
    alone = _count_target(Scene(scene.instances[:1]), camera)
    return _count_target(scene, camera) / alone if alone > 150 else 0.0


def _count_target(scene: Scene, camera: Camera) -> int:
    _, ids = render_depth(scene, camera)
    return int((ids == TARGET_ID).sum())
