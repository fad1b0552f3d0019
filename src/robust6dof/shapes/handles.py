"""Handles: loops from the wall and back to it, of many curves and sections."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from robust6dof.shapes.atlas import Slot
from robust6dof.shapes.draw import Draw
from robust6dof.shapes.loft import Part, sweep


def handle(draw: Draw, wall: Float[np.ndarray, "N 2"], height: float, slot: Slot) -> Part:
    """A closed tube in the x–y plane whose two ends lie in the wall.

    Args:
        draw: where the parameters come from.
        wall: outline (radius, height) of the body [m].
        height: height of the body [m].
        slot: where the handle's image lies.
    """
    top = height * draw.uniform("handle_top", 0.68, 0.95)
    bottom = height * draw.uniform("handle_bottom", 0.08, 0.4)
    reach = draw.uniform("handle_reach", 0.022, 0.048)
    thick = draw.uniform("handle_thickness", 0.004, 0.009) / 2
    wide = draw.uniform("handle_width", 0.007, 0.022) / 2
    path = _loop(draw, top, bottom, reach)
    radius = np.interp(path[:, 1], wall[:, 1], wall[:, 0])
    chord = np.linspace(radius[0], radius[-1], len(path))
    path[:, 0] += chord
    widths = np.tile([thick, wide], (len(path), 1)) * _thickening(draw, len(path))[:, None]
    exponent = draw.uniform("handle_exponent", 2.0, 5.0)
    return sweep(path, widths, slot, exponent)


def _loop(draw: Draw, top: float, bottom: float, reach: float) -> Float[np.ndarray, "N 3"]:
    """Centre line, x from the wall, starting and ending a little inside it."""
    kind = draw.choice("handle_curve", {"C": 0.45, "D": 0.25, "ear": 0.2, "square": 0.1})
    power = {"C": 2.0, "D": 3.0, "ear": 2.2, "square": 7.0}[kind]
    angle = np.linspace(np.pi / 2, -np.pi / 2, 28)
    c, s = np.cos(angle), np.sin(angle)
    radius = (np.abs(c) ** power + np.abs(s) ** power) ** (-1 / power)
    x, y = reach * radius * c, radius * s
    if kind == "ear":
        x = x * (1 + 0.25 * y)
    y = (top + bottom) / 2 + (top - bottom) / 2 * y
    inside = 0.006
    x = np.concatenate([[-inside], x, [-inside]])
    y = np.concatenate([[y[0]], y, [y[-1]]])
    return np.column_stack([x, y, np.zeros_like(x)])


def _thickening(draw: Draw, count: int) -> Float[np.ndarray, "N"]:
    """Thicker towards the wall, or not."""
    extra = draw.uniform("handle_root", 0.0, 0.5)
    return 1 + extra * np.abs(np.linspace(-1, 1, count)) ** 4
