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
from robust6dof.simulation.model import Surface
from robust6dof.simulation.motion import (
    Circle,
    Excursion,
    Path,
    Still,
    StopAndGo,
    Straight,
    moved_along,
)
from robust6dof.simulation.primitives import box, plain
from robust6dof.simulation.room import (
    Lighting,
    Support,
    draw_cart,
    draw_lighting,
    draw_room,
    draw_table,
    floor_surface,
)
from robust6dof.simulation.scenario import Scenario

TARGET_ID = 1
"""`instance_id` of the target in every rendering."""

VEHICLE_ID = 2
"""Of the vehicle's own parts."""

_OTHERS_ID = 3

_UPRIGHT = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""R_world_obj of an object that stands: its y is the world's z."""


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
    T_world_obj = _standing(target, place, support.surface.top, rng)
    path = _draw_path(scenario, rng)
    others = _draw_clutter(scenario, options, target, T_world_obj, support.surface, rng)
    occluder = _draw_occluder(T_world_obj, rng) if scenario.occlusion else None
    return World(
        target,
        T_world_obj,
        path,
        support,
        draw_room(rng, scenario.half_width),
        others,
        draw_lighting(rng),
        scenario.half_width,
        occluder,
    )


def _standing(
    thing: ObjectModel, place: Float[np.ndarray, "2"], top: float, rng: np.random.Generator
) -> Float[np.ndarray, "4 4"]:
    turn = Rotation.from_euler("z", rng.uniform(-np.pi, np.pi)).as_matrix()
    height = top + thing.extents[1] / 2.0
    return make_transform(turn @ _UPRIGHT, np.array([*place, height]))


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
        return StopAndGo(speed, heading)
    if motion == "excursion":
        distance, travel = rng.uniform(1.2, 1.8), rng.uniform(1.5, 2.5)
        return Excursion(distance, heading, rng.uniform(6.0, 9.0), travel, pause=2.0)
    return Still()


def _draw_clutter(
    scenario: Scenario,
    options: EpisodeOptions,
    target: ObjectModel,
    T_world_obj: Float[np.ndarray, "4 4"],
    surface: Surface,
    rng: np.random.Generator,
) -> tuple[MeshInstance, ...]:
    """Objects standing beside the target, none touching another."""
    low, high = scenario.clutter
    names = [c for c in CATEGORIES if options.same_category_clutter or c != target.category]
    taken = [(T_world_obj[:2, 3], _footprint(target))]
    placed: list[MeshInstance] = []
    for _ in range(int(rng.integers(low, high + 1))):
        thing = make_object(str(rng.choice(names)), rng)
        place = _free_place(_footprint(thing), taken, surface, rng)
        if place is not None:
            taken.append((place, _footprint(thing)))
            T_world_thing = _standing(thing, place, surface.top, rng)
            placed.append(MeshInstance(thing.mesh, T_world_thing, _OTHERS_ID))
    return tuple(placed)


def _footprint(thing: ObjectModel) -> float:
    """Radius of the circle around the object, seen from above [m]."""
    return float(np.hypot(thing.extents[0], thing.extents[2])) / 2.0


def _free_place(
    radius: float,
    taken: list[tuple[Float[np.ndarray, "2"], float]],
    surface: Surface,
    rng: np.random.Generator,
) -> Float[np.ndarray, "2"] | None:
    half = np.array(surface.size) / 2.0 - radius
    turn = Rotation.from_euler("z", surface.yaw).as_matrix()[:2, :2]
    for _ in range(60):
        place = turn @ rng.uniform(-half, half)
        if all(np.linalg.norm(place - at) > radius + other + 0.03 for at, other in taken):
            return place
    return None


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
