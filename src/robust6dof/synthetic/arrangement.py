"""Objects standing on a level surface, none touching another."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from robust6dof.geometry.transforms import make_transform
from robust6dof.shapes.mesh import ObjectModel
from robust6dof.shapes.procedural import make_object
from robust6dof.synthetic.room import Surface

R_WORLD_UPRIGHT = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""R_world_obj of an object that stands: its y is the world's z."""

_GAP = 0.03
_TRIES = 60

ObjectSource = Callable[[str, np.random.Generator], ObjectModel]
"""Draws an object of a category."""


@dataclass(frozen=True, eq=False)
class StandingObject:
    """An object and where it stands."""

    model: ObjectModel
    T_world_obj: Float[np.ndarray, "4 4"]

    @property
    def footprint(self) -> float:
        """Radius of the circle around it, seen from above [m]."""
        return _footprint(self.model)


def _footprint(model: ObjectModel) -> float:
    return float(np.hypot(model.extents[0], model.extents[2])) / 2.0


def stand(
    model: ObjectModel, place: Float[np.ndarray, "2"], top: float, rng: np.random.Generator
) -> StandingObject:
    """The object on a surface of height `top` [m], turned anyhow."""
    turn = Rotation.from_euler("z", rng.uniform(-np.pi, np.pi)).as_matrix()
    height = top + model.extents[1] / 2.0
    T_world_obj = make_transform(turn @ R_WORLD_UPRIGHT, np.array([*place, height]))
    return StandingObject(model, T_world_obj)


def stand_around(
    target: StandingObject,
    surface: Surface,
    count: int,
    categories: Sequence[str],
    rng: np.random.Generator,
    *,
    among: Sequence[StandingObject] = (),
    draw: ObjectSource = make_object,
    crowding: int = 1,
) -> tuple[StandingObject, ...]:
    """`count` objects beside the target, fewer where there is no room.

    Args:
        target: which they stand around.
        surface: on which all stand.
        count: how many.
        categories: to draw from.
        rng: where all randomness comes from.
        among: what stands there already beside the target.
        draw: makes an object.
        crowding: each takes the place nearest to the target out of so many free ones.
    """
    taken, placed = [target, *among], []
    for _ in range(count):
        model = draw(str(rng.choice(categories)), rng)
        thing = _stand_free(model, taken, surface, crowding, rng)
        if thing is not None:
            taken.append(thing)
            placed.append(thing)
    return tuple(placed)


def _stand_free(
    model: ObjectModel,
    taken: Sequence[StandingObject],
    surface: Surface,
    crowding: int,
    rng: np.random.Generator,
) -> StandingObject | None:
    radius = _footprint(model)
    free = [_free_place(radius, taken, surface, rng) for _ in range(crowding)]
    places = [place for place in free if place is not None]
    if not places:
        return None
    target = taken[0].T_world_obj[:2, 3]
    nearest = min(places, key=lambda place: float(np.linalg.norm(place - target)))
    return stand(model, nearest, surface.top, rng)


def _free_place(
    radius: float,
    taken: Sequence[StandingObject],
    surface: Surface,
    rng: np.random.Generator,
) -> Float[np.ndarray, "2"] | None:
    half = np.array(surface.size) / 2.0 - radius
    turn = Rotation.from_euler("z", surface.yaw).as_matrix()[:2, :2]
    for _ in range(_TRIES):
        place = np.array(surface.center) + turn @ rng.uniform(-half, half)
        gaps = [np.linalg.norm(place - t.T_world_obj[:2, 3]) - t.footprint for t in taken]
        if all(gap > radius + _GAP for gap in gaps):
            return place
    return None
