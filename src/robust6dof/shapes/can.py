"""Cans: drink cans with a neck, food cans with rims and ribs, slim and flat ones."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from robust6dof.shapes.atlas import pack
from robust6dof.shapes.draw import Draw
from robust6dof.shapes.labels import can_lid, label
from robust6dof.shapes.loft import box, revolve, rounded
from robust6dof.shapes.mesh import ObjectModel
from robust6dof.shapes.solid import finish, union
from robust6dof.shapes.textures import any_pattern, grain, material, metal, solid

_RIM = 0.0016
"""Half width of the seam at a can's ends [m]."""


def make_can(draw: Draw) -> ObjectModel:
    """One lathe profile (bottom, side, seam, recessed lid), and perhaps a pull tab."""
    kind = draw.choice("kind", {"drink": 0.5, "food": 0.35, "slim": 0.1, "flat": 0.05})
    radius = draw.uniform("radius", *_RADIUS[kind])
    height = 2 * radius * draw.uniform("height_over_diameter", *_HEIGHT[kind])
    recess = draw.uniform("lid_recess", 0.002, 0.007)
    steel = metal(draw.rng)
    opened = draw.chance("opened", 0.2)
    has_label = draw.chance("label", 0.75)
    wrap = (label if has_label else any_pattern)(draw.rng, 160, 256)
    images = {
        "side": grain(wrap, draw.rng),
        "lid": can_lid(draw.rng, steel, opened),
        "metal": grain(solid(steel, 16, 16), draw.rng, 6.0),
    }
    atlas = pack(images)
    bottom, side, lid = _profile(draw, kind, radius, height, recess)
    metal_part = atlas["metal"]
    parts = [revolve([(bottom, metal_part), (side, atlas["side"]), (lid, atlas["lid"])])]
    if draw.chance("tab", 0.6):
        tab = box((0.3 * radius, 0.75 * radius, 0.0016), 0.15 * radius, 0.0005, metal_part)
        parts.append(tab.moved(_LYING, (0.2 * radius, height - recess + 0.0006, 0)))
    return finish(union(parts), atlas, material(draw, matt=0.2), "can", draw)


_LYING = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
_RADIUS = {
    "drink": (0.027, 0.036),
    "food": (0.026, 0.052),
    "slim": (0.024, 0.03),
    "flat": (0.03, 0.055),
}
"""Radius [m]."""
_HEIGHT = {"drink": (1.3, 2.4), "food": (0.85, 1.8), "slim": (2.2, 2.9), "flat": (0.4, 0.85)}
"""Height over diameter."""


def _profile(
    draw: Draw, kind: str, radius: float, height: float, recess: float
) -> tuple[Float[np.ndarray, "A 2"], Float[np.ndarray, "B 2"], Float[np.ndarray, "C 2"]]:
    """Bottom, side and lid as (radius, height)."""
    necked = kind in ("drink", "slim")
    top = radius * (1 - (draw.uniform("neck", 0.06, 0.2) if necked else 0.0))
    low = radius * (1 - (draw.uniform("base_taper", 0.06, 0.22) if necked else 0.0))
    upper = (radius - top) * draw.uniform("neck_slope", 0.9, 1.8) + 0.001
    lower = (radius - low) * draw.uniform("base_slope", 0.4, 1.0) + 0.001
    seam = 0.003 if not necked else 0.0012
    bottom = _bottom(low, seam, necked)
    wall = _ribs(draw, kind, radius, seam + lower, height - 0.003 - upper)
    corners = np.vstack([bottom[-1:], wall, [[top, height - 0.003]]])
    radii = [0.006] + [0.0] * (len(wall) - 2) + [0.006]
    side = rounded(corners, radii, 4)
    out = top + _RIM
    lid = [
        [top, height - 0.003], [out, height - 0.0025], [out, height - 0.0006],
        [top + 0.5 * _RIM, height], [top - 0.5 * _RIM, height], [top - _RIM, height - 0.001],
        [top - 1.5 * _RIM, height - recess], [0.6 * top, height - recess], [0, height - recess],
    ]  # fmt: skip
    return bottom, side, np.array(lid)


def _bottom(low: float, seam: float, necked: bool) -> Float[np.ndarray, "A 2"]:
    """A dome inside a standing ring; food cans have the seam of the lid at the bottom too."""
    if necked:
        return np.array([
            [0, 0.008], [0.5 * low, 0.006], [0.8 * low, 0.002], [0.86 * low, 0], [0.95 * low, 0],
            [low, seam],
        ])  # fmt: skip
    return np.array([
        [0, 0.003], [low - 2 * _RIM, 0.003], [low - _RIM, 0], [low + 0.5 * _RIM, 0],
        [low + _RIM, 0.0006], [low + _RIM, 0.0025], [low, seam],
    ])  # fmt: skip


def _ribs(
    draw: Draw, kind: str, radius: float, low: float, high: float
) -> Float[np.ndarray, "N 2"]:
    """The straight wall, ribbed on some food cans."""
    depth = draw.uniform("rib_depth", -0.02, 0.03) if kind == "food" else 0.0
    if depth <= 0.004:
        return np.array([[radius, low], [radius, high]])
    t = np.linspace(0, 1, 33)
    count = round(draw.uniform("ribs", 3, 8))
    inside = (t > 0.2) & (t < 0.8)
    wave = np.where(inside, np.sin(np.pi * count * (t - 0.2) / 0.6) ** 2, 0.0)
    return np.column_stack([radius * (1 - depth * wave), low + (high - low) * t])
