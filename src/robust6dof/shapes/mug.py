"""Mugs and cups: straight, tapered, bellied and square bodies with a handle towards +x."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from robust6dof.shapes.atlas import pack
from robust6dof.shapes.draw import Draw
from robust6dof.shapes.handles import handle
from robust6dof.shapes.loft import ROUND, Part, Section, revolve, rounded
from robust6dof.shapes.mesh import ObjectModel
from robust6dof.shapes.solid import finish, subtract, union
from robust6dof.shapes.textures import material, near, pattern, random_color, solid


def make_mug(draw: Draw) -> ObjectModel:
    """A hollow vessel and its handle, joined to one closed surface."""
    atlas = pack(_images(draw))
    wall_profile = _outline(draw)
    height = float(wall_profile[-1, 1])
    wall = draw.uniform("wall", 0.0025, 0.006)
    section = _section(draw)
    inner = _inset(wall_profile, wall)
    floor = draw.uniform("floor", 0.003, 0.009)
    body = _vessel(wall_profile, inner, floor, section, atlas)
    core = _core(wall_profile, inner, section, atlas)
    grip = subtract(handle(draw, wall_profile, height, atlas["handle"]), [core])
    return finish(union([body, grip]), atlas, material(draw, matt=0.3), "mug", draw)


def _images(draw: Draw) -> dict[str, np.ndarray]:
    outside = pattern(draw, "outside", 128, 256)
    mean = outside.reshape(-1, 3).mean(axis=0).astype(np.uint8)
    own = draw.choice("inside", {"white": 0.4, "outside": 0.35, "other": 0.25})
    inside = {"white": np.full(3, 240, np.uint8), "outside": mean, "other": random_color(draw.rng)}
    same = draw.chance("handle_as_body", 0.75)
    grip = mean if same else random_color(draw.rng)
    return {
        "outside": outside,
        "inside": solid(inside[own], 16, 32),
        "handle": solid(grip, 16, 32),
        "bottom": solid(near(mean, draw.rng, 25), 8, 8),
    }


def _section(draw: Draw) -> Section:
    if draw.choice("section", {"round": 0.9, "square": 0.1}) == "round":
        return ROUND
    return Section(exponent=draw.uniform("section_exponent", 2.5, 5.0))


def _outline(draw: Draw) -> Float[np.ndarray, "N 2"]:
    """(radius, height) from the bottom's edge to the rim."""
    height = draw.uniform("height", 0.06, 0.14)
    rim = height * draw.uniform("rim_radius_over_height", 0.33, 0.72)
    rim = min(rim, 0.065)
    taper = draw.uniform("base_radius_over_rim", 0.6, 1.08)
    belly = draw.uniform("belly", -0.08, 0.16)
    flare = draw.uniform("flare", -0.03, 0.08)
    t = np.linspace(0, 1, 14)
    radius = rim * (taper + (1 - taper) * t ** draw.uniform("taper_power", 0.5, 1.2))
    radius = radius * (1 + belly * np.sin(np.pi * t) + flare * np.clip((t - 0.8) / 0.2, 0, 1) ** 2)
    return np.column_stack([radius, height * t])


def _inset(outline: Float[np.ndarray, "N 2"], wall: float) -> Float[np.ndarray, "N 2"]:
    return np.column_stack([outline[:, 0] - wall, outline[:, 1]])


def _vessel(outline, inner, floor: float, section: Section, atlas) -> Part:
    height, base = outline[-1, 1], outline[0, 0]
    foot = min(0.004, 0.1 * base)
    bottom = np.array([[0, foot / 2], [0.75 * base, foot / 2], [0.8 * base, 0], [base, 0]])
    lip = (outline[-1, 0] + inner[-1, 0]) / 2
    rise = (outline[-1, 0] - inner[-1, 0]) / 2
    outside = np.vstack([bottom[-1:] * [0.94, 1], outline[1:], [lip, height + rise]])
    outside = rounded(outside, [0.0] * (len(outside) - 2))
    inside = inner[inner[:, 1] > floor + 0.01][::-1]
    inside = np.vstack([[lip, height + rise], inside, [inside[-1, 0], floor], [0, floor]])
    inside = rounded(inside, 0.008)
    bottom = np.vstack([bottom[:-1], outside[:1]])
    return revolve(
        [(bottom, atlas["bottom"]), (outside, atlas["outside"]), (inside, atlas["inside"])], section
    )


def _core(outline, inner, section: Section, atlas) -> Part:
    """What the handle must keep out of: the cavity and half of the wall."""
    middle = (outline + inner) / 2
    ends = [[0, middle[0, 1] - 0.01]], [[middle[0, 0], middle[0, 1] - 0.01]]
    top = [[middle[-1, 0], middle[-1, 1] + 0.05]], [[0, middle[-1, 1] + 0.05]]
    profile = np.vstack([*ends, middle, *top])
    return revolve([(profile, atlas["inside"])], section)
