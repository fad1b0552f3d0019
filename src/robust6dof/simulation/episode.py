"""One drawn instance of a scenario: object, room, light, start. The same seed draws the same."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from robust6dof.frames import CATEGORIES, SYMMETRIC_CATEGORIES
from robust6dof.geometry.transforms import invert_transform, make_transform
from robust6dof.rendering.scene import MeshInstance, Scene
from robust6dof.shapes.mesh import ObjectModel, TexturedMesh
from robust6dof.shapes.procedural import make_object
from robust6dof.simulation.scenario import Scenario
from robust6dof.synthetic.arrangement import StandingObject, stand, stand_around
from robust6dof.synthetic.paths import (
    Circle,
    Excursion,
    Path,
    Still,
    StopAndGo,
    Straight,
    moved_along,
    way,
)
from robust6dof.synthetic.primitives import box, plain
from robust6dof.synthetic.room import (
    Lighting,
    Support,
    Surface,
    draw_cart,
    draw_lighting,
    draw_room,
    draw_table,
    floor_surface,
)

TARGET_ID = 1
"""`instance_id` of the target in every rendering."""

VEHICLE_ID = 2
"""Of the vehicle's own parts."""

_OTHERS_ID = 3

_LONGEST_RUN_S = 60.0
"""The way of a moving target is kept free of furniture for so long [s]."""


@dataclass(frozen=True)
class EpisodeOptions:
    """What a user fixes about the draw."""

    category: str | None = None
    """Of the target; drawn if None."""
    same_category_clutter: bool = False
    """Clutter of the target's own category too."""


@dataclass(frozen=True, eq=False)
class Occluder:
    """A board that passes over the object."""

    mesh: TexturedMesh
    T_world_board: Float[np.ndarray, "4 4"]
    path: Path


@dataclass(frozen=True, eq=False)
class World:
    """Everything but the vehicle, at any time."""

    target: ObjectModel
    T_world_obj_start: Float[np.ndarray, "4 4"]
    path: Path
    support: Support
    room: tuple[TexturedMesh, ...]
    clutter: tuple[MeshInstance, ...]
    lighting: Lighting
    half_width: float
    """From the middle of the room to its walls [m]."""
    occluder: Occluder | None = None

    @property
    def symmetric(self) -> bool:
        """Whether the target's turn about its y means nothing."""
        return self.target.category in SYMMETRIC_CATEGORIES

    @property
    def surfaces(self) -> tuple[Surface, ...]:
        """What the vehicle can touch, beside the target."""
        still = () if self.support.moves else (self.support.surface,)
        return (floor_surface(self.half_width), *still)

    def T_world_obj(self, time: float) -> Float[np.ndarray, "4 4"]:
        """The target at `time` [s]."""
        return moved_along(self.path, self.T_world_obj_start, time)

    def scene(self, time: float, *more: MeshInstance) -> Scene:
        """What is to be seen at `time` [s], with `more` (the vehicle) in it."""
        T_world_support = self.support.T_world_support
        if self.support.moves:
            T_world_support = moved_along(self.path, T_world_support, time)
        instances = [MeshInstance(self.target.mesh, self.T_world_obj(time), TARGET_ID)]
        instances += [MeshInstance(mesh, np.eye(4), _OTHERS_ID) for mesh in self.room]
        instances += [
            MeshInstance(mesh, T_world_support, _OTHERS_ID) for mesh in self.support.meshes
        ]
        instances += self.clutter
        if self.occluder is not None:
            T_world_board = moved_along(self.occluder.path, self.occluder.T_world_board, time)
            instances.append(MeshInstance(self.occluder.mesh, T_world_board, _OTHERS_ID))
        lighting = self.lighting
        return Scene([*instances, *more], lighting.lights, lighting.ambient, (200, 205, 210))


@dataclass(frozen=True, eq=False)
class Episode:
    """One run's beginning."""

    scenario: Scenario
    seed: int
    world: World
    T_world_body: Float[np.ndarray, "4 4"]
    joints: Float[np.ndarray, "4"]


def draw_world(scenario: Scenario, options: EpisodeOptions, seed: int) -> World:
    """Object, room, clutter, light and motion of one seed.

    Raises:
        InputError: an unknown category.
    """
    rng = np.random.default_rng([seed, 1])
    category = options.category or str(rng.choice(CATEGORIES))
    target = make_object(category, rng)
    support = draw_table(rng) if scenario.on_table else draw_cart(rng)
    reach = 0.12 if scenario.on_table else 0.0
    place = rng.uniform(-reach, reach, 2)
    standing = stand(target, place, support.surface.top, rng)
    T_world_obj = standing.T_world_obj
    path = _draw_path(scenario, rng)
    others = _draw_clutter(scenario, options, standing, support.surface, rng)
    occluder = _draw_occluder(T_world_obj, rng) if scenario.occlusion else None
    return World(
        target,
        T_world_obj,
        path,
        support,
        draw_room(rng, scenario.half_width, way(path, _LONGEST_RUN_S)),
        others,
        draw_lighting(rng),
        scenario.half_width,
        occluder,
    )


def _draw_path(scenario: Scenario, rng: np.random.Generator) -> Path:
    speed, heading = rng.uniform(*scenario.speed), rng.uniform(-np.pi, np.pi)
    motion = scenario.motion
    if motion == "mixed":
        motion = str(rng.choice(["straight", "circle", "stop-and-go"]))
    if motion == "straight":
        return Straight(speed, heading)
    if motion == "circle":
        return Circle(speed, float(rng.uniform(0.6, 1.0)), heading)
    if motion == "stop-and-go":
        return StopAndGo(speed / 2.0, heading)  # it takes the mean of a drive, half its top speed
    if motion == "excursion":
        distance, travel = rng.uniform(1.2, 1.8), rng.uniform(1.5, 2.5)
        return Excursion(distance, heading, rng.uniform(6.0, 9.0), travel, pause=2.0)
    return Still()


def _draw_clutter(
    scenario: Scenario,
    options: EpisodeOptions,
    target: StandingObject,
    surface: Surface,
    rng: np.random.Generator,
) -> tuple[MeshInstance, ...]:
    low, high = scenario.clutter
    category = target.model.category
    names = [c for c in CATEGORIES if options.same_category_clutter or c != category]
    others = stand_around(target, surface, int(rng.integers(low, high + 1)), names, rng)
    return tuple(MeshInstance(o.model.mesh, o.T_world_obj, _OTHERS_ID) for o in others)


def _draw_occluder(T_world_obj: Float[np.ndarray, "4 4"], rng: np.random.Generator) -> Occluder:
    """A board a hand's breadth above the object that crosses it at a walking hand's pace."""
    heading = rng.uniform(-np.pi, np.pi)
    along = np.array([np.cos(heading), np.sin(heading), 0.0])
    start = T_world_obj[:3, 3] - 1.2 * along + np.array([0.0, 0.0, 0.28])
    R_world_board = Rotation.from_euler("z", heading).as_matrix()
    mesh = box((0.25, 0.35, 0.006), plain(214, 190, 150))
    path = Straight(rng.uniform(0.35, 0.5), heading, start=rng.uniform(2.0, 6.0))
    return Occluder(mesh, make_transform(R_world_board, start), path)


def goal_camera(
    world: World, T_cam_obj_goal: Float[np.ndarray, "4 4"], time: float = 0.0
) -> Float[np.ndarray, "4 4"]:
    """T_world_cam of the goal at `time` [s]."""
    return world.T_world_obj(time) @ invert_transform(T_cam_obj_goal)
