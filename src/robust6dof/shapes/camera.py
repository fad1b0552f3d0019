"""Cameras: reflex, mirrorless, rangefinder, compact, bridge and instant; the lens towards +x."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from robust6dof.shapes.atlas import Atlas, pack
from robust6dof.shapes.camera_parts import FACING_X, block, dial, grip, lens, prism
from robust6dof.shapes.draw import Draw
from robust6dof.shapes.labels import camera_back, camera_front, lens_barrel
from robust6dof.shapes.loft import Part, box
from robust6dof.shapes.mesh import ObjectModel
from robust6dof.shapes.solid import finish, union
from robust6dof.shapes.textures import (
    Color,
    Image,
    grain,
    grey,
    material,
    metal,
    noise,
    random_color,
    solid,
)


@dataclass(frozen=True)
class Kind:
    """Ranges of one kind of camera, relative to the body's width or height."""

    weight: float
    width: tuple[float, float]
    """Of the body [m]."""
    height: tuple[float, float]
    """Over width."""
    depth: tuple[float, float]
    """Over width."""
    lens_radius: tuple[float, float]
    """Over the body's height."""
    lens_length: tuple[float, float]
    """Over the body's width."""
    lens_offset: tuple[float, float]
    """Along z over the body's width; the grip is at +z."""
    hump: float = 0.0
    """Chance of a prism."""
    grip: float = 0.0
    """Chance of a grip."""
    dials: float = 0.0
    """Chance of dials."""
    rounding: tuple[float, float] = (0.08, 0.25)
    """Of the body's corners, over its height."""


KINDS = {
    "reflex": Kind(0.28, (0.12, 0.155), (0.58, 0.75), (0.3, 0.48), (0.34, 0.46), (0.2, 0.85),
                   (-0.14, 0.0), hump=1.0, grip=0.9, dials=0.8),
    "mirrorless": Kind(0.18, (0.1, 0.135), (0.48, 0.66), (0.24, 0.38), (0.38, 0.5), (0.2, 0.7),
                       (-0.14, 0.0), hump=0.5, grip=0.7, dials=0.8),
    "rangefinder": Kind(0.16, (0.11, 0.15), (0.5, 0.64), (0.2, 0.34), (0.3, 0.42), (0.12, 0.4),
                        (-0.06, 0.06), hump=0.15, dials=0.9),
    "compact": Kind(0.22, (0.085, 0.12), (0.52, 0.68), (0.18, 0.34), (0.26, 0.42), (0.04, 0.34),
                    (-0.2, 0.0), grip=0.15, dials=0.4, rounding=(0.05, 0.45)),
    "bridge": Kind(0.08, (0.105, 0.13), (0.6, 0.78), (0.35, 0.55), (0.36, 0.48), (0.4, 0.9),
                   (-0.16, -0.04), hump=1.0, grip=1.0, dials=0.7),
    "instant": Kind(0.08, (0.1, 0.155), (0.68, 0.98), (0.35, 0.65), (0.2, 0.34), (0.08, 0.3),
                    (-0.12, 0.12), rounding=(0.05, 0.3)),
}  # fmt: skip
"""Kinds of cameras; each part's own draws are beside it."""


def make_camera(draw: Draw) -> ObjectModel:
    """The union of a rounded body, a stepped lens and what sits on the body."""
    name = draw.choice("kind", {key: kind.weight for key, kind in KINDS.items()})
    kind = KINDS[name]
    width = draw.uniform("width", *kind.width)
    height = width * draw.uniform("height_over_width", *kind.height)
    depth = width * draw.uniform("depth_over_width", *kind.depth)
    atlas = pack(_images(draw, width, height))
    size = (width, height, depth)
    radius = height * draw.uniform("rounding", *kind.rounding)
    bevel = depth * draw.uniform("bevel", 0.03, 0.3)
    slots = (atlas["front"], atlas["side"], atlas["back"])
    body = box(size, radius, bevel, slots).moved(FACING_X)
    offset = width * draw.uniform("lens_offset_over_width", *kind.lens_offset)
    lens_radius = height * draw.uniform("lens_radius_over_height", *kind.lens_radius)
    length = width * draw.uniform("lens_length_over_width", *kind.lens_length)
    drop = min(0.08 * height, height / 2 - lens_radius) * draw.uniform("lens_drop", -0.6, 1.0)
    start = np.array([depth / 2, -drop, offset])
    barrel = lens(draw, lens_radius, length, start, atlas, sink=0.4 * depth)
    parts = [body, barrel, *_top(draw, kind, size, offset, atlas)]
    parts += _front(draw, kind, name, size, offset, lens_radius, atlas)
    return finish(union(parts), atlas, material(draw), "camera", draw)


def _top(
    draw: Draw, kind: Kind, size: tuple[float, float, float], offset: float, atlas: Atlas
) -> list[Part]:
    """Prism or hot shoe, dials and the shutter's button."""
    width, height, depth = size
    parts, roof = [], height / 2
    if draw.chance("hump", kind.hump):
        tall = height * draw.uniform("hump_height", 0.16, 0.34)
        wide = width * draw.uniform("hump_width", 0.28, 0.46)
        deep = depth * draw.uniform("hump_depth", 0.6, 0.95)
        parts.append(prism(wide, tall, deep, np.array([0.0, roof - 0.002, offset]), atlas))
    elif draw.chance("shoe", 0.4):
        shoe = (0.02, 0.005, 0.018)
        parts.append(block(shoe, np.array([0.0, roof + 0.0015, offset]), atlas, "metal"))
    button = np.array([0.1 * depth, roof, 0.36 * width])
    parts.append(dial(0.005, draw.uniform("button", 0.001, 0.006), button, atlas))
    if draw.chance("dials", kind.dials):
        for place in (0.27, -0.36) if draw.chance("two_dials", 0.6) else (0.27,):
            spot = np.array([-0.12 * depth, roof, place * width])
            radius = min(draw.uniform("dial_radius", 0.006, 0.011), 0.3 * depth)
            parts.append(dial(radius, draw.uniform("dial_height", 0.003, 0.01), spot, atlas))
    return parts


def _front(
    draw: Draw,
    kind: Kind,
    name: str,
    size: tuple[float, float, float],
    offset: float,
    lens_radius: float,
    atlas: Atlas,
) -> list[Part]:
    """Grip, viewfinder window and flash, and an instant camera's jutting foot."""
    width, height, depth = size
    parts, face = [], depth / 2
    if draw.chance("grip", kind.grip):
        wide = width * draw.uniform("grip_width", 0.16, 0.26)
        reach = depth * draw.uniform("grip_reach", 0.2, 0.6)
        tall = height * draw.uniform("grip_height", 0.82, 0.98)
        place = np.array([face, -(height - tall) / 2 * 0.9, 0.49 * width - wide / 2])
        parts.append(grip(wide, tall, reach, place, atlas))
    if draw.chance("window", 0.6):
        window = (0.13 * width, 0.13 * height, 0.005)
        side = -0.36 if offset > -0.1 * width or name == "instant" else 0.2
        place = np.array([face, 0.34 * height, side * width])
        image = draw.choice("window_kind", {"flash": 0.6, "glass": 0.4})
        parts.append(block(window, place, atlas, image))
    if name == "instant" and draw.chance("foot", 0.6):
        reach = depth * draw.uniform("foot_reach", 0.3, 0.8)
        low = min(0.3 * height, height / 2 - 0.9 * lens_radius)
        foot = box((0.94 * width, low, 2 * reach), 0.2 * low, 0.15 * low, atlas["plate"])
        parts.append(foot.moved(FACING_X, (face, -height / 2 + low / 2 + 0.001, 0.0)))
    return parts


def _images(draw: Draw, width: float, height: float) -> dict[str, Image]:
    rng = draw.rng
    plate, leather, two_tone = _colors(draw)
    skin = _leather(rng, leather)
    line = 0.75 if two_tone else 1.01
    front = _two_tone(skin, plate, line)
    barrel = grey(rng.integers(12, 50)) if rng.random() < 0.75 else metal(rng)
    tint = np.array([rng.integers(5, 40), rng.integers(5, 40), rng.integers(20, 90)])
    return {
        "front": camera_front(rng, front, named=rng.random() < 0.6),
        "back": camera_back(rng, front),
        "side": _side(plate, leather, line, width, height),
        "leather": skin[:32, :32],
        "plate": grain(solid(plate, 32, 32), rng),
        "lens": lens_barrel(rng, barrel, 48, 64),
        "rim": grain(solid(barrel, 16, 32), rng),
        "glass": solid(tint.astype(np.uint8), 16, 16),
        "flash": grain(solid(np.array([225, 225, 210], np.uint8), 12, 16), rng, 12),
        "metal": grain(solid(metal(rng), 12, 16), rng),
        "knurl": lens_barrel(rng, grey(60), 12, 48),
    }


def _colors(draw: Draw) -> tuple[Color, Color, bool]:
    """Of the plates and of the leather, and whether they differ."""
    rng = draw.rng
    kind = draw.choice(
        "colours", {"black": 0.45, "two-tone": 0.25, "silver": 0.15, "coloured": 0.15}
    )
    black = grey(rng.integers(12, 45))
    if kind == "two-tone":
        plate = metal(rng) if rng.random() < 0.75 else random_color(rng)
        return plate, black if rng.random() < 0.7 else random_color(rng), True
    one = {"black": black, "silver": metal(rng), "coloured": random_color(rng)}[kind]
    return one, one, False


def _leather(rng: np.random.Generator, color: Color) -> Image:
    texture = 1 + rng.uniform(0.05, 0.5) * (noise(rng, 72, 112, 6) - 0.5)
    return np.clip(color * texture[..., None], 0, 255).astype(np.uint8)


def _two_tone(skin: Image, plate: Color, line: float) -> Image:
    """The plate's colour above a relative height, and a strip of it below."""
    image = skin.copy()
    rows = len(image)
    if line < 1:
        image[: round((1 - line) * rows)] = plate
        image[round(0.9 * rows) :] = plate
    return image


def _side(plate: Color, leather: Color, line: float, width: float, height: float) -> Image:
    """Around the body: top, left, bottom, right, as the outline of a box runs."""
    around = np.linspace(0, 2 * (width + height), 128, endpoint=False)
    up = np.interp(around, np.cumsum([0, width, height, width, height]), [1, 1, 0, 0, 1])
    row = np.where(((up > line) | (up < 0.1))[:, None] & (line < 1), plate, leather)
    return np.repeat(row[None].astype(np.uint8), 8, axis=0)
