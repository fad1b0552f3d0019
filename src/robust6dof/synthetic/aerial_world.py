"""The world of an aerial recording: the target among others on a table or a cart, in a room."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from robust6dof.frames import CATEGORIES
from robust6dof.geometry.transforms import invert_transform
from robust6dof.rendering.scene import MeshInstance, Scene
from robust6dof.shapes.mesh import ObjectModel, TexturedMesh
from robust6dof.shapes.procedural import make_object
from robust6dof.synthetic.arrangement import StandingObject, stand, stand_around
from robust6dof.synthetic.difficulty import Difficulty
from robust6dof.synthetic.paths import Circle, Path, Still, StopAndGo, Straight, moved_along, way
from robust6dof.synthetic.room import (
    Lighting,
    Support,
    draw_cart,
    draw_lighting,
    draw_room,
    draw_table,
)

TARGET_ID = 1
"""`instance_id` of the target in every rendering."""
CARRIED_ID = 2
"""Of what moves with the target: the cart, and what stands on it."""
STILL_ID = 3
"""Of everything that stands still."""

_BACKDROP = (200, 205, 210)
_CROWDING = 6


@dataclass(frozen=True, eq=False)
class AerialWorld:
    """Everything but camera and occluders, at any time; z up, the floor at 0."""

    target: StandingObject
    others: tuple[StandingObject, ...]
    support: Support
    path: Path
    """Of the support and all on it."""
    room: tuple[TexturedMesh, ...]
    lighting: Lighting

    @staticmethod
    def draw(
        rng: np.random.Generator,
        target: ObjectModel,
        bounds: Difficulty,
        duration: float,
        alike: Sequence[ObjectModel] = (),
    ) -> AerialWorld:
        """A world of the given difficulty.

        Args:
            rng: where all randomness comes from.
            target: the object to be tracked.
            bounds: the difficulty.
            duration: the way of a cart is kept free for so long [s].
            alike: objects to draw distractors of the target's category from; procedural ones if
                there are none.
        """
        moves = rng.random() < bounds.moving_share
        support = draw_cart(rng, side=(0.65, 0.9)) if moves else draw_table(rng)
        path = _draw_path(rng, bounds.target_speed) if moves else Still()
        standing = stand(target, rng.uniform(-0.1, 0.1, 2), support.surface.top, rng)
        trail = way(path, duration)
        half_width = rng.uniform(2.9, 4.2) + float(np.abs(trail).max())
        return AerialWorld(
            standing,
            _draw_others(rng, standing, support, bounds, alike),
            support,
            path,
            draw_room(rng, half_width, trail),
            draw_lighting(rng),
        )

    @property
    def moves(self) -> bool:
        """Whether the target does."""
        return self.support.moves

    def T_world_carrier(self, t: float) -> Float[np.ndarray, "4 4"]:
        """The support at time `t` [s]."""
        return moved_along(self.path, self.support.T_world_support, t)

    def T_world_obj(self, t: float) -> Float[np.ndarray, "4 4"]:
        """The target at time `t` [s]."""
        return self._carried(t) @ self.target.T_world_obj

    def scene(self, t: float, *more: MeshInstance) -> Scene:
        """What is to be seen at time `t` [s], with `more` in it."""
        beside = CARRIED_ID if self.moves else STILL_ID
        carried = self._carried(t)
        T_world_support = self.T_world_carrier(t)
        instances = [MeshInstance(self.target.model.mesh, self.T_world_obj(t), TARGET_ID)]
        instances += [MeshInstance(mesh, T_world_support, beside) for mesh in self.support.meshes]
        for other in self.others:
            instances.append(MeshInstance(other.model.mesh, carried @ other.T_world_obj, beside))
        instances += [MeshInstance(mesh, np.eye(4), STILL_ID) for mesh in self.room]
        light = self.lighting
        return Scene([*instances, *more], light.lights, light.ambient, _BACKDROP)

    def _carried(self, t: float) -> Float[np.ndarray, "4 4"]:
        """From places at time 0 to places at `t`, in the world, of all that the support carries."""
        return self.T_world_carrier(t) @ invert_transform(self.support.T_world_support)


def _draw_path(rng: np.random.Generator, speed: float) -> Path:
    """A ground vehicle's way; `speed` [m/s] is the highest on it."""
    heading, start = rng.uniform(-np.pi, np.pi), rng.uniform(0.0, 0.5)
    kind = int(rng.integers(3))
    if kind == 0:
        return Straight(speed, heading, start)
    if kind == 1:
        return Circle(speed, rng.uniform(0.4, 0.9), heading, start)
    # Its speed is a raised sine of mean `speed / 2`.
    return StopAndGo(speed / 2.0, heading, rng.uniform(1.0, 2.5), start)


def _draw_others(
    rng: np.random.Generator,
    target: StandingObject,
    support: Support,
    bounds: Difficulty,
    alike: Sequence[ObjectModel],
) -> tuple[StandingObject, ...]:
    """Objects of the target's own category, then of others, crowded about it."""

    def draw(category: str, rng: np.random.Generator) -> ObjectModel:
        if alike and category == target.model.category:
            return alike[int(rng.integers(len(alike)))]
        return make_object(category, rng)

    own = target.model.category
    foreign = [category for category in CATEGORIES if category != own]
    distractors, clutter = bounds.distractors, bounds.clutter
    like = int(rng.integers(distractors[0], distractors[1] + 1))
    rest = int(rng.integers(clutter[0], clutter[1] + 1))
    surface = support.surface
    same = stand_around(target, surface, like, [own], rng, draw=draw, crowding=_CROWDING)
    other = stand_around(
        target, surface, rest, foreign, rng, among=same, draw=draw, crowding=_CROWDING
    )
    return (*same, *other)
