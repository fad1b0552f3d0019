"""Mugs and cups: straight, tapered, bellied and square bodies with a handle towards +x."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from robust6dof.shapes.atlas import Atlas, pack
from robust6dof.shapes.draw import Draw
from robust6dof.shapes.handles import handle
from robust6dof.shapes.labels import decorated
from robust6dof.shapes.loft import ROUND, Part, Section, revolve
from robust6dof.shapes.mesh import ObjectModel
from robust6dof.shapes.solid import finish, subtract, union
from robust6dof.shapes.textures import grain, grey, material, mean_color, near, random_color, solid


def make_mug(draw: Draw) -> ObjectModel:
    """A hollow vessel and its handle, joined to one closed surface."""
    atlas = pack(_images(draw))
    outline = _outline(draw)
    wall = draw.uniform("wall", 0.002, 0.006)
    floor = draw.uniform("floor", 0.003, 0.009)
    section = _section(draw)
    inner = outline - [wall, 0.0]
    body = _vessel(outline, inner, floor, section, atlas)
    core = _core(outline, inner, section, atlas)
    grip = subtract(handle(draw, outline, atlas["handle"]), [core])
    return finish(union([body, grip]), atlas, material(draw, matt=0.3), "mug", draw)


def _images(draw: Draw) -> dict[str, np.ndarray]:
    outside = grain(decorated(draw.rng, 160, 256), draw.rng)
    mean = mean_color(outside)
    kind = draw.choice("inside", {"white": 0.4, "as outside": 0.35, "other": 0.25})
    colors = {
        "white": grey(240),
        "as outside": mean,
        "other": random_color(draw.rng),
    }
    same = draw.chance("handle_as_body", 0.75)
    edge = mean_color(outside[:, :8])
    return {
        "outside": outside,
        "inside": solid(colors[kind], 16, 32),
        "handle": solid(edge if same else random_color(draw.rng), 16, 32),
        "bottom": solid(near(mean, draw.rng, 25)),
    }


def _section(draw: Draw) -> Section:
    if draw.choice("section", {"round": 0.92, "square": 0.08}) == "round":
        return ROUND
    return Section(exponent=draw.uniform("section_exponent", 2.5, 5.0))


def _outline(draw: Draw) -> Float[np.ndarray, "N 2"]:
    """(radius, height) from the bottom's edge to the rim."""
    height = draw.uniform("height", 0.055, 0.145)
    rim = min(height * draw.uniform("rim_radius_over_height", 0.32, 0.75), 0.068)
    base = draw.uniform("base_radius_over_rim", 0.55, 1.1)
    belly = draw.uniform("belly", -0.08, 0.18)
    power = draw.uniform("taper_power", 0.35, 1.3)
    lip = draw.uniform("lip_flare", -0.03, 0.08)
    t = np.linspace(0, 1, 12)
    radius = rim * (base + (1 - base) * t**power)
    radius = radius * (1 + belly * np.sin(np.pi * t) + lip * np.clip((t - 0.75) / 0.25, 0, 1) ** 2)
    return np.column_stack([radius, height * t])


def _vessel(
    outline: Float[np.ndarray, "N 2"],
    inner: Float[np.ndarray, "N 2"],
    floor: float,
    section: Section,
    atlas: Atlas,
) -> Part:
    """Bottom with a foot ring, outside, rounded lip, inside."""
    base, height = outline[0, 0], outline[-1, 1]
    middle, half = (outline[-1, 0] + inner[-1, 0]) / 2, (outline[-1, 0] - inner[-1, 0]) / 2
    bottom = np.array([[0, 0.002], [0.75 * base, 0.002], [0.8 * base, 0], [0.95 * base, 0]])
    lip = [[middle + 0.7 * half, height + 0.7 * half], [middle, height + half]]
    outside = np.vstack([bottom[-1:], outline[0:1] + [0, 0.05 * base], outline[1:], lip])
    down = inner[inner[:, 1] > floor + 0.006][::-1]
    corner = [[down[-1, 0] - 0.001, floor + 0.002], [down[-1, 0] - 0.004, floor], [0, floor]]
    lip = [[middle, height + half], [middle - 0.7 * half, height + 0.7 * half]]
    inside = np.vstack([lip, down, corner])
    bands = [(bottom, atlas["bottom"]), (outside, atlas["outside"]), (inside, atlas["inside"])]
    return revolve(bands, section)


def _core(
    outline: Float[np.ndarray, "N 2"],
    inner: Float[np.ndarray, "N 2"],
    section: Section,
    atlas: Atlas,
) -> Part:
    """What the handle must keep out of: the cavity and half of the wall."""
    middle = ((outline + inner) / 2)[::2]
    low, high = middle[0] - [0, 0.03], middle[-1] + [0, 0.05]
    profile = np.vstack([low * [0, 1], low, middle, high, high * [0, 1]])
    return revolve([(profile, atlas["inside"])], section)
