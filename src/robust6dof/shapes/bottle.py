"""Bottles: round and flat bodies, shoulders, necks, waists and ribs; caps, pumps and handles."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from robust6dof.shapes.atlas import Atlas, pack
from robust6dof.shapes.bottle_tops import make_top
from robust6dof.shapes.draw import Draw
from robust6dof.shapes.handles import handle
from robust6dof.shapes.labels import label
from robust6dof.shapes.loft import ROUND, Section, revolve, rounded
from robust6dof.shapes.mesh import ObjectModel
from robust6dof.shapes.solid import finish, union
from robust6dof.shapes.textures import any_pattern, grain, material, near, random_color, solid

SHOULDERS = {"round": 0.4, "cone": 0.25, "slope": 0.2, "square": 0.15}
"""How the body passes into the neck, and how often."""


def make_bottle(draw: Draw) -> ObjectModel:
    """A lathe profile (base, label, shoulder, neck), a top, and on some a handle at +x."""
    atlas = pack(_images(draw))
    height = draw.uniform("height", 0.12, 0.33)
    radius = max(height * draw.uniform("width_over_height", 0.21, 0.5), 0.036) / 2
    neck = max(radius * draw.uniform("neck_over_body", 0.22, 0.85), 0.008)
    body, lip = _body(draw, height, radius, neck)
    section = _section(draw, radius, neck)
    low, high = draw.uniform("label_low", 0.03, 0.35), draw.uniform("label_high", 0.45, 0.8)
    cuts = [np.searchsorted(body[:, 1], share * lip) for share in (low, high)]
    bands = _bands(body, [int(cut) for cut in cuts], atlas)
    top = make_top(draw, neck, radius, lip, height, atlas)
    close = np.array([body[-1], [0, lip]])
    parts = [revolve([*bands, (close, atlas["upper"])], section), *top]
    if draw.chance("handle", 0.08):
        parts.append(handle(draw, body[body[:, 0] > 0.6 * neck], atlas["upper"]))
    return finish(union(parts), atlas, material(draw), "bottle", draw)


def _images(draw: Draw) -> dict[str, np.ndarray]:
    color = random_color(draw.rng)
    kind = draw.choice("surface", {"label": 0.65, "pattern": 0.2, "bare": 0.15})
    makers = {"label": label, "pattern": any_pattern}
    plain = solid(near(color, draw.rng, 8), 128, 256)
    return {
        "label": grain(makers[kind](draw.rng, 128, 256) if kind in makers else plain, draw.rng),
        "lower": grain(solid(color, 24, 32), draw.rng),
        "upper": grain(solid(near(color, draw.rng, 8), 24, 32), draw.rng),
        "cap": grain(solid(random_color(draw.rng), 24, 32), draw.rng),
    }


def _body(
    draw: Draw, height: float, radius: float, neck: float
) -> tuple[Float[np.ndarray, "N 2"], float]:
    """(radius, height) from the base's middle to the lip, and the lip's height."""
    lip = height * draw.uniform("lip_over_height", 0.86, 0.97)
    # A wide neck is short: its shoulder sits high.
    lowest = 0.42 + 0.45 * neck / radius
    shoulder = lip * (lowest + (0.92 - lowest) * draw.uniform("shoulder_place", 0.0, 1.0))
    kind = draw.choice("shoulder", SHOULDERS)
    rise = {"round": 1.1, "cone": 1.6, "slope": 3.0, "square": 0.35}[kind] * (radius - neck)
    neck_start = min(shoulder + max(rise, 0.004), lip - 0.006)
    shoulder = min(shoulder, neck_start - 0.004)
    t = np.linspace(0, 1, 9)
    ease = {
        "round": np.sqrt(np.clip(1 - t**2, 0, 1)),
        "cone": 1 - t,
        "slope": (1 + np.cos(np.pi * t)) / 2,
        "square": (1 - t**4),
    }[kind]
    arc = np.column_stack([neck + (radius - neck) * ease, shoulder + (neck_start - shoulder) * t])
    wall = _wall(draw, radius, 0.03 * lip, shoulder)
    edge = draw.uniform("base_edge", 0.002, 0.012)
    foot = [[0, 0.004], [0.7 * radius, 0.004], [0.78 * radius, 0], [radius * 0.98, 0]]
    base = rounded(np.vstack([foot, wall[:1]]), [0.002, 0.002, edge], 4)
    return np.vstack([base, wall[1:], arc[1:], [[neck, lip]]]), lip


def _wall(draw: Draw, radius: float, low: float, high: float) -> Float[np.ndarray, "N 2"]:
    """The body's wall: straight, tapered, waisted or ribbed."""
    t = np.linspace(0, 1, 25)
    taper = draw.uniform("taper", -0.12, 0.12)
    waist = draw.uniform("waist", -0.1, 0.16) if draw.chance("waisted", 0.35) else 0.0
    profile = 1 - max(taper, 0) * (1 - t) + min(taper, 0) * t - waist * np.sin(np.pi * t) ** 2
    profile[-1] = 1 + min(taper, 0)
    if draw.chance("ribbed", 0.15):
        count = round(draw.uniform("ribs", 4, 10))
        profile -= draw.uniform("rib_depth", 0.01, 0.04) * np.sin(np.pi * count * t) ** 2
    scale = profile * radius / max(1.0, profile.max())
    return np.column_stack([scale, low + (high - low) * t])


def _section(draw: Draw, radius: float, neck: float) -> Section:
    if draw.choice("section", {"round": 0.72, "flat": 0.28}) == "round":
        return ROUND
    exponent = draw.uniform("section_exponent", 2.0, 6.0)
    aspect = draw.uniform("depth_over_width", 0.5, 1.0)
    blend_from = min(1.1 * neck, 0.9 * radius)
    return Section(exponent, aspect, 0, 0.0, blend_from, max(0.92 * radius, blend_from + 1e-3))


def _bands(body: Float[np.ndarray, "N 2"], cuts: list[int], atlas: Atlas) -> list:
    low = min(max(cuts[0], 2), len(body) - 3)
    high = min(max(cuts[1], low + 1), len(body) - 2)
    pieces = [("lower", 0, low), ("label", low, high), ("upper", high, len(body) - 1)]
    return [(body[first : last + 1], atlas[name]) for name, first, last in pieces]
