"""What stands about in a room: cupboards and shelves at the walls, small things on the floor."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from jaxtyping import Float, UInt8
from scipy.spatial.transform import Rotation

from robust6dof.geometry.transforms import make_transform
from robust6dof.shapes.mesh import TexturedMesh
from robust6dof.synthetic.primitives import box, cylinder, joined, moved, placed, plain
from robust6dof.synthetic.room_textures import carpet_texture, picture_texture, wood_texture

CLEAR_M = 1.3
"""Free floor about the middle of what stands or drives in the room."""

_WALL_DEPTH = 0.02
_COVERS = 12
_Parts = tuple[TexturedMesh, ...]


def draw_wall_furniture(rng: np.random.Generator, half_width: float) -> _Parts:
    """Along each wall: something that stands before it and a picture beside that."""
    parts: list[TexturedMesh] = []
    kinds = (_cupboard, _shelf)
    reach = min(half_width, 4.0) - 1.2
    for wall in range(4):
        inward = Rotation.from_euler("z", wall * np.pi / 2).as_matrix()
        at = rng.uniform(-reach, 0.0)
        T_wall = make_transform(inward, inward @ [at, half_width - _WALL_DEPTH, 0.0])
        parts += [moved(part, T_wall) for part in kinds[int(rng.integers(2))](rng)]
        beside = make_transform(inward, inward @ [at + 1.5, half_width - _WALL_DEPTH, 1.5])
        parts += [moved(part, beside) for part in _picture(rng)]
    return tuple(parts)


def draw_floor_things(
    rng: np.random.Generator, half_width: float, clear: Float[np.ndarray, "P 2"]
) -> _Parts:
    """A few low things about the places `clear` (x, y) [m], never nearer than `CLEAR_M`."""
    kinds: tuple[Callable[[np.random.Generator], _Parts], ...] = (_carton, _stool, _bin, _carton)
    parts: list[TexturedMesh] = []
    for _ in range(int(rng.integers(4, 9))):
        angle, away = rng.uniform(-np.pi, np.pi), rng.uniform(CLEAR_M, 2.8)
        about = clear[int(rng.integers(len(clear)))]
        place = about + away * np.array([np.cos(angle), np.sin(angle)])
        thing = kinds[int(rng.integers(len(kinds)))](rng)
        is_free = np.linalg.norm(clear - place, axis=1).min() >= CLEAR_M
        if is_free and np.abs(place).max() < half_width - 0.8:
            R = Rotation.from_euler("z", angle + rng.uniform(0.0, np.pi)).as_matrix()
            parts += [moved(part, make_transform(R, np.array([*place, 0.0]))) for part in thing]
    return tuple(parts)


def draw_rug(rng: np.random.Generator) -> TexturedMesh:
    """A carpet on the floor, about the middle of the room."""
    size = (rng.uniform(1.6, 2.6), rng.uniform(1.2, 1.8), 0.01)
    rug = box(size, carpet_texture(rng), tile=0.8)
    R = Rotation.from_euler("z", rng.uniform(-np.pi, np.pi)).as_matrix()
    return moved(rug, make_transform(R, np.array([*rng.uniform(-0.5, 0.5, 2), 0.005])))


def _cupboard(rng: np.random.Generator) -> _Parts:
    width, depth, height = rng.uniform(0.7, 1.3), rng.uniform(0.35, 0.5), rng.uniform(0.7, 1.9)
    paint = wood_texture(rng)
    body = placed(box((width, depth, height), paint, tile=0.9), 0.0, -depth / 2, height / 2)
    door = box((width / 2 - 0.01, 0.015, height - 0.06), paint, tile=0.7)
    doors = [placed(door, side * width / 4, -depth - 0.0075, height / 2) for side in (-1, 1)]
    knob = cylinder(0.012, 0.05, plain(60, 60, 64))
    knobs = [placed(knob, side * 0.04, -depth - 0.03, height / 2) for side in (-1, 1)]
    return joined([body, *doors]), joined(knobs)


def _shelf(rng: np.random.Generator) -> _Parts:
    width, depth, height = rng.uniform(0.7, 1.2), rng.uniform(0.25, 0.35), rng.uniform(1.0, 2.0)
    paint = wood_texture(rng)
    side = box((0.02, depth, height), paint, tile=0.8)
    boards = [placed(side, s * width / 2, -depth / 2, height / 2) for s in (-1, 1)]
    board = box((width - 0.02, depth, 0.02), paint, tile=0.8)
    covers = rng.integers(30, 225, (1, _COVERS, 3)).astype(np.uint8)
    books: list[TexturedMesh] = []
    for level in np.arange(0.06, height, 0.38):
        boards.append(placed(board, 0.0, -depth / 2, level))
        books += _books(rng, covers, width - 0.1, depth, float(level) + 0.01)
    return joined(boards), joined(books)


def _books(
    rng: np.random.Generator,
    covers: UInt8[np.ndarray, "1 C 3"],
    width: float,
    depth: float,
    level: float,
) -> _Parts:
    """Upright boxes that fill a part of a board, each in one of the colours of `covers`."""
    books, at = [], -width / 2
    end = at + width * rng.uniform(0.3, 1.0)
    while at < end:
        thick, height = rng.uniform(0.02, 0.07), rng.uniform(0.16, 0.28)
        book = placed(
            box((thick, 0.7 * depth, height), covers),
            at + thick / 2,
            -depth / 2,
            level + height / 2,
        )
        color = (rng.integers(_COVERS) + 0.5) / _COVERS
        books.append(replace(book, uv=np.full_like(book.uv, 0.5) * [2 * color, 1.0]))
        at += thick + 0.003
    return tuple(books)


def _picture(rng: np.random.Generator) -> _Parts:
    width, height = rng.uniform(0.4, 0.9), rng.uniform(0.4, 0.7)
    frame = box((width + 0.05, 0.02, height + 0.05), plain(50, 44, 40))
    sheet = box((width, 0.01, height), picture_texture(rng), tile=float(height))
    return placed(frame, 0.0, -0.01, 0.0), placed(sheet, 0.0, -0.025, 0.0)


def _carton(rng: np.random.Generator) -> _Parts:
    width, depth, height = (float(side) for side in rng.uniform(0.2, 0.5, 3))
    brown = np.array([186, 148, 104]) * rng.uniform(0.7, 1.15)
    body = box((width, depth, height), plain(*(int(c) for c in np.minimum(brown, 255))))
    tape = box((0.05, depth + 0.002, height + 0.002), plain(206, 186, 150))
    return tuple(placed(part, 0.0, 0.0, height / 2 + 0.001) for part in (body, tape))


def _stool(rng: np.random.Generator) -> _Parts:
    height, radius = rng.uniform(0.38, 0.48), rng.uniform(0.15, 0.2)
    seat = placed(cylinder(radius, 0.04, wood_texture(rng), tile=0.5), 0.0, 0.0, height)
    leg = cylinder(0.016, height - 0.02, plain(70, 66, 62), sides=8)
    spread = 0.65 * radius
    corners = [(x * spread, y * spread) for x in (-1, 1) for y in (-1, 1)]
    return seat, joined([placed(leg, x, y, height / 2 - 0.01) for x, y in corners])


def _bin(rng: np.random.Generator) -> _Parts:
    height, radius = rng.uniform(0.25, 0.45), rng.uniform(0.12, 0.18)
    body = placed(cylinder(radius, height, _any_color(rng)), 0.0, 0.0, height / 2)
    rim = placed(cylinder(0.9 * radius, 0.004, plain(30, 30, 32)), 0.0, 0.0, height + 0.002)
    return body, rim


def _any_color(rng: np.random.Generator) -> UInt8[np.ndarray, "1 1 3"]:
    red, green, blue = (int(c) for c in rng.integers(30, 225, 3))
    return plain(red, green, blue)
