"""What closes a bottle: screw caps, corks, nozzles, flip tops, pumps, triggers, or nothing."""

from __future__ import annotations

import numpy as np

from robust6dof.shapes.atlas import Atlas
from robust6dof.shapes.draw import Draw
from robust6dof.shapes.loft import Part, Section, box, revolve, rounded, sweep

TOPS = {
    "screw": 0.5,
    "nozzle": 0.12,
    "flip": 0.12,
    "cork": 0.08,
    "none": 0.08,
    "pump": 0.06,
    "trigger": 0.04,
}
"""Kinds of tops and how often each comes."""


def make_top(
    draw: Draw, neck: float, radius: float, lip: float, height: float, atlas: Atlas
) -> list[Part]:
    """Closed parts from the lip up to about the bottle's height; they overlap the neck.

    Args:
        draw: where the parameters come from.
        neck: radius of the neck [m].
        radius: of the body [m].
        lip: height of the neck's end [m].
        height: of the bottle with a plain cap [m].
        atlas: has the image "cap".
    """
    kind = draw.choice("top", TOPS)
    slot, rise = atlas["cap"], height - lip
    wide = neck * draw.uniform("cap_over_neck", 1.04, 1.3)
    low = lip - draw.uniform("cap_overlap", 0.004, 0.016)
    if kind == "none":
        ring = rounded(_rectangle(neck * 1.1, lip - 0.006, lip + 0.001), [0.001, 0.001])
        return [revolve([(ring, slot)])]
    if kind == "flip":
        wide = max(wide, 0.85 * radius * draw.uniform("flip_width", 0.6, 1.0))
    if kind == "cork":
        wide, low = 0.85 * neck, lip - 0.004
    flutes = round(draw.uniform("cap_flutes", 20, 40))
    section = Section(2.0, 1.0, flutes, 0.03, 0.0, 1e-6) if kind == "screw" else Section()
    cap = revolve([(rounded(_rectangle(wide, low, lip + rise), 0.0025, 3), slot)], section, 64)
    extras = {"nozzle": _nozzle, "pump": _pump, "trigger": _trigger}
    return [cap, *(extras[kind](draw, wide, lip + rise, atlas) if kind in extras else [])]


def _rectangle(radius: float, low: float, high: float) -> np.ndarray:
    return np.array([[0, low], [radius, low], [radius, high], [0, high]])


def _nozzle(draw: Draw, wide: float, base: float, atlas: Atlas) -> list[Part]:
    """A cone, as on sauce and glue bottles, or a pull cap."""
    tall = draw.uniform("nozzle_height", 0.012, 0.045)
    root = wide * draw.uniform("nozzle_root", 0.3, 0.7)
    tip = root * draw.uniform("nozzle_tip", 0.25, 0.8)
    cone = np.array([[0, base - 0.002], [root, base - 0.002], [tip, base + tall], [0, base + tall]])
    return [revolve([(rounded(cone, 0.002), atlas["cap"])], count=24)]


def _pump(draw: Draw, wide: float, base: float, atlas: Atlas) -> list[Part]:
    """A stem and a head whose spout points to +x."""
    tall, reach = draw.uniform("pump_height", 0.015, 0.04), draw.uniform("pump_reach", 0.02, 0.045)
    stem = _rectangle(0.3 * wide, base - 0.002, base + tall)
    head = rounded(_rectangle(0.65 * wide, base + tall - 0.003, base + tall + 0.012), 0.003)
    heights = base + tall + np.array([0.006, 0.007, 0.007, 0.005, -0.003])
    along = np.array([0.0, 0.3, 0.7, 0.95, 1.0]) * reach
    path = np.column_stack([along, heights, np.zeros(5)])
    spout = sweep(path, np.full((5, 2), 0.004), atlas["cap"], count=12)
    return [*(revolve([(part, atlas["cap"])], count=24) for part in (stem, head)), spout]


def _trigger(draw: Draw, wide: float, base: float, atlas: Atlas) -> list[Part]:
    """A sprayer: a body along x with its nozzle at +x, and a curved lever below."""
    length, tall = draw.uniform("trigger_length", 0.05, 0.08), 0.022
    body = box((length, tall, 0.022), 0.006, 0.003, atlas["cap"])
    stem = _rectangle(0.6 * wide, base - 0.002, base + 0.02)
    x = 0.2 * length
    path = np.array(
        [[x, 0.022, 0], [x + 0.004, 0.006, 0], [x + 0.007, -0.01, 0], [x + 0.014, -0.026, 0]]
    )
    path[:, 1] += base
    lever = sweep(path, np.tile([0.003, 0.007], (4, 1)), atlas["cap"], 3.0, 12)
    placed = body.moved(np.eye(3), (0.15 * length, base + 0.012 + tall / 2, 0))
    return [revolve([(stem, atlas["cap"])], count=24), placed, lever]
