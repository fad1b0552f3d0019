"""Bowls: shallow to deep, with foot rings, flared rims, fluted and squarish ones."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from robust6dof.shapes.atlas import pack
from robust6dof.shapes.draw import Draw
from robust6dof.shapes.labels import decorated
from robust6dof.shapes.loft import ROUND, Section, revolve, rounded
from robust6dof.shapes.mesh import ObjectModel
from robust6dof.shapes.solid import finish
from robust6dof.shapes.textures import (
    any_pattern,
    grain,
    grey,
    material,
    mean_color,
    random_color,
    solid,
)


def make_bowl(draw: Draw) -> ObjectModel:
    """One lathe profile: foot, outside, lip, inside."""
    atlas = pack(_images(draw))
    outer, bottom = _outer(draw)
    inner = _inner(draw, outer)
    bands = [(bottom, atlas["bottom"]), (outer, atlas["outside"]), (inner, atlas["inside"])]
    section = _section(draw, float(outer[:, 0].max()))
    part = revolve(bands, section)
    return finish(part, atlas, material(draw, matt=0.3), "bowl", draw)


def _images(draw: Draw) -> dict[str, np.ndarray]:
    outside = grain(decorated(draw.rng, 96, 256), draw.rng)
    mean = mean_color(outside)
    kind = draw.choice(
        "inside", {"as outside": 0.35, "white": 0.25, "pattern": 0.25, "other": 0.15}
    )
    colors = {
        "as outside": mean,
        "white": grey(240),
        "other": random_color(draw.rng),
    }
    inside = any_pattern(draw.rng, 96, 256) if kind == "pattern" else solid(colors[kind], 16, 32)
    return {"outside": outside, "inside": inside, "bottom": solid(mean)}


def _outer(draw: Draw) -> tuple[Float[np.ndarray, "N 2"], Float[np.ndarray, "M 2"]]:
    radius = draw.uniform("rim_radius", 0.05, 0.11)
    height = radius * draw.uniform("height_over_rim_radius", 0.45, 1.3)
    base = radius * draw.uniform("base_over_rim", 0.35, 0.7)
    foot = height * draw.uniform("foot_height", 0.0, 0.14)
    # 1 is a cone; large powers give a bucket.
    power = draw.uniform("roundness", 1.2, 3.2)
    t = np.linspace(0, 1, 16)
    curve = np.column_stack(
        [
            base + (radius - base) * (1 - (1 - t) ** power) ** (1 / power) ** 0.8,
            foot + (height - foot) * t**1.15,
        ]
    )
    flare = draw.uniform("flare", -0.04, 0.12)
    curve[:, 0] += flare * radius * np.clip((t - 0.75) / 0.25, 0, 1) ** 2
    ring = base * draw.uniform("foot_taper", 0.85, 1.0)
    start = [[ring, 0.0]] if foot > 0.002 else []
    outer = np.vstack([*start, curve]) if start else curve
    floor = [[0, 0.3 * foot], [0.85 * ring, 0.3 * foot], [0.9 * outer[0, 0], outer[0, 1]], outer[0]]
    return outer, np.array(floor)


def _inner(draw: Draw, outer: Float[np.ndarray, "N 2"]) -> Float[np.ndarray, "M 2"]:
    wall = draw.uniform("wall", 0.002, 0.006)
    curve = outer[-16:]
    tangent = np.gradient(curve, axis=0)
    normal = np.column_stack([-tangent[:, 1], tangent[:, 0]])
    inside = curve + wall * normal / np.linalg.norm(normal, axis=1, keepdims=True)
    floor = max(inside[0, 1], wall)
    inside = inside[(inside[:, 1] > floor + 1e-4) & (inside[:, 0] > 0.2 * curve[0, 0])][::-1]
    rim = curve[-1] + [-wall / 2, wall / 2]
    inside[0, 1] = min(inside[0, 1], curve[-1, 1])
    profile = np.vstack([curve[-1], rim, inside, [0.6 * inside[-1, 0], floor], [0, floor]])
    return rounded(profile, [wall / 2] * 2 + [0.0] * (len(profile) - 4), 3)


def _section(draw: Draw, radius: float) -> Section:
    kind = draw.choice("section", {"round": 0.8, "square": 0.1, "fluted": 0.1})
    if kind == "square":
        return Section(
            draw.uniform("section_exponent", 2.5, 4.5), 1.0, 0, 0.0, 0.5 * radius, radius
        )
    if kind == "fluted":
        depth = draw.uniform("flute_depth", 0.02, 0.06)
        flutes = int(draw.uniform("flutes", 6, 14))
        return Section(2.0, 1.0, flutes, depth, 0.5 * radius, radius)
    return ROUND
