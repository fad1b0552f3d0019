"""Where it happens: a room with a table or a cart, drawn at random."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import Rotation

from robust6dof.geometry.transforms import make_transform
from robust6dof.rendering.scene import Light
from robust6dof.shapes.mesh import Material, TexturedMesh
from robust6dof.synthetic.furniture import draw_floor_things, draw_rug, draw_wall_furniture
from robust6dof.synthetic.primitives import box, cylinder, joined, moved, placed, plain
from robust6dof.synthetic.room_textures import floor_texture, table_texture, wall_texture

_HEIGHT = 3.0
_CART_TOP = 0.22


@dataclass(frozen=True)
class Surface:
    """A level rectangle that one can land on: a floor, a table top."""

    center: tuple[float, float]
    """x, y in the world [m]."""
    size: tuple[float, float]
    """Along x and y [m]."""
    top: float
    """Height of its upper side [m]."""
    yaw: float = 0.0
    """Turn about the vertical [rad]."""
    thickness: float = 0.03
    """[m]"""

    def covers(self, points: Float[np.ndarray, "P 3"]) -> Bool[np.ndarray, "P"]:
        """Whether each point lies over (or under) it."""
        c, s = np.cos(self.yaw), np.sin(self.yaw)
        offset = points[:, :2] - np.array(self.center)
        local = offset @ np.array([[c, -s], [s, c]])
        inside = np.abs(local) <= np.array(self.size) / 2.0
        return inside[:, 0] & inside[:, 1]


@dataclass(frozen=True, eq=False)
class Support:
    """What the target stands on, as one mesh in its own frame (z up, origin on the floor)."""

    meshes: tuple[TexturedMesh, ...]
    T_world_support: Float[np.ndarray, "4 4"]
    surface: Surface
    moves: bool
    """Whether it goes where the target goes."""


@dataclass(frozen=True, eq=False)
class Lighting:
    """Lights, ambient light and what shows where no wall is."""

    lights: tuple[Light, ...]
    ambient: tuple[float, float, float]


def draw_room(
    rng: np.random.Generator, half_width: float, clear: Float[np.ndarray, "P 2"]
) -> tuple[TexturedMesh, ...]:
    """Floor, walls and what stands about, in world coordinates.

    Args:
        rng: where all randomness comes from.
        half_width: of the walls from the middle [m].
        clear: places (x, y) of the table or along the cart's way, about which the floor is free.
    """
    wide = 2.0 * half_width
    floor = placed(box((wide, wide, 0.02), floor_texture(rng), tile=1.2), 0.0, 0.0, -0.01)
    paint = wall_texture(rng)
    walls = []
    for x, y in ((1, 0), (-1, 0), (0, 1), (0, -1)):
        size = (0.02, wide, _HEIGHT) if x else (wide, 0.02, _HEIGHT)
        wall = box(size, paint, tile=1.5)
        walls.append(placed(wall, x * half_width, y * half_width, _HEIGHT / 2.0))
    furniture = rng.spawn(1)[0]
    return (
        floor,
        joined(walls),
        draw_rug(furniture),
        *draw_floor_things(furniture, half_width, clear),
        *draw_wall_furniture(furniture, half_width),
    )


def draw_table(rng: np.random.Generator) -> Support:
    """A table with four legs in the middle of the room."""
    width, depth = rng.uniform(1.1, 1.6), rng.uniform(0.75, 1.0)
    height, yaw = rng.uniform(0.68, 0.78), rng.uniform(-np.pi, np.pi)
    top = placed(
        box((width, depth, 0.03), table_texture(rng), tile=0.6, material=_draw_gloss(rng)),
        0.0,
        0.0,
        height - 0.015,
    )
    leg = box((0.05, 0.05, height - 0.03), plain(70, 66, 62))
    corners = [(x * (width / 2 - 0.06), y * (depth / 2 - 0.06)) for x in (-1, 1) for y in (-1, 1)]
    legs = [placed(leg, x, y, (height - 0.03) / 2.0) for x, y in corners]
    T_world_support = make_transform(Rotation.from_euler("z", yaw).as_matrix(), np.zeros(3))
    surface = Surface((0.0, 0.0), (width, depth), height, yaw)
    return Support((top, joined(legs)), T_world_support, surface, moves=False)


def draw_cart(rng: np.random.Generator, side: tuple[float, float] = (0.45, 0.6)) -> Support:
    """A low ground vehicle with a flat square top, its side drawn from the range `side` [m]."""
    width, yaw = rng.uniform(*side), rng.uniform(-np.pi, np.pi)
    top = placed(
        box((width, width, 0.02), table_texture(rng), tile=0.5), 0.0, 0.0, _CART_TOP - 0.01
    )
    hull = placed(box((0.8 * width, 0.7 * width, 0.1), plain(60, 72, 90)), 0.0, 0.0, 0.14)
    on_side = Rotation.from_euler("x", 90, degrees=True).as_matrix()
    wheel = cylinder(0.07, 0.04, plain(25, 25, 28))
    places = [(x * 0.3 * width, y * 0.4 * width) for x in (-1, 1) for y in (-1, 1)]
    wheels = [moved(wheel, make_transform(on_side, np.array([x, y, 0.07]))) for x, y in places]
    T_world_support = make_transform(Rotation.from_euler("z", yaw).as_matrix(), np.zeros(3))
    surface = Surface((0.0, 0.0), (width, width), _CART_TOP, yaw)
    return Support((top, hull, joined(wheels)), T_world_support, surface, moves=True)


def draw_lighting(rng: np.random.Generator) -> Lighting:
    """Two lamps from above, on different sides, and the light that the walls give back."""
    lights = []
    first = rng.uniform(0.0, 2.0 * np.pi)
    second = first + rng.uniform(0.6, 1.4) * np.pi
    for azimuth, strength in ((first, rng.uniform(0.4, 0.6)), (second, rng.uniform(0.12, 0.3))):
        height = rng.uniform(0.6, 1.3)
        towards = np.array([np.cos(azimuth), np.sin(azimuth), -height])
        warmth = rng.uniform(0.88, 1.0)
        color = (strength, strength * (0.5 + 0.5 * warmth), strength * warmth)
        lights.append(Light(towards / np.linalg.norm(towards), color))
    level = rng.uniform(0.36, 0.5)
    return Lighting(tuple(lights), (level, level, level))


def floor_surface(half_width: float) -> Surface:
    """The floor, for contact and ground effect."""
    return Surface((0.0, 0.0), (2.0 * half_width, 2.0 * half_width), 0.0, thickness=0.1)


def _draw_gloss(rng: np.random.Generator) -> Material:
    return Material(specular=rng.uniform(0.0, 0.15), shininess=rng.uniform(8.0, 40.0))
