"""Handles: loops from the wall and back to it, of many curves and sections."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from robust6dof.shapes.atlas import Slot
from robust6dof.shapes.draw import Draw
from robust6dof.shapes.loft import Part, sweep

CURVES = {"C": 0.35, "D": 0.25, "ear": 0.15, "square": 0.1, "ring": 0.1, "hook": 0.05}
"""Shapes of a handle and how often each comes."""
_POWER = {"C": 2.0, "D": 3.2, "ear": 2.2, "square": 7.0, "ring": 2.0, "hook": 2.4}


def handle(draw: Draw, wall: Float[np.ndarray, "N 2"], slot: Slot) -> Part:
    """A closed tube in the x–y plane, towards +x, whose ends lie in the wall.

    Args:
        draw: where the parameters come from.
        wall: outline (radius, height) of the body [m].
        slot: where the handle's image lies.
    """
    height = float(wall[-1, 1])
    curve = draw.choice("handle_curve", CURVES)
    top = height * draw.uniform("handle_top", 0.7, 0.95)
    share = draw.uniform("handle_length", 0.4, 0.85) * (0.7 if curve == "ring" else 1.0)
    bottom = max(top - share * height, 0.07 * height)
    thick = height * draw.uniform("handle_thickness", 0.05, 0.1) / 2
    wide = height * draw.uniform("handle_width", 0.06, 0.2) / 2
    wide = min(wide, 0.5 * float(wall[:, 0].min()))
    reach = np.clip(height * draw.uniform("handle_reach", 0.22, 0.46), 0.018, 0.055)
    path = _loop(curve, top - thick, bottom + thick, float(reach))
    path[:, 0] += _wall_chord(path, wall, curve)
    widths = np.outer(_thickening(draw, len(path)), [thick, wide])
    return sweep(path, widths, slot, draw.uniform("handle_exponent", 2.0, 5.0), count=14)


def _loop(curve: str, top: float, bottom: float, reach: float) -> Float[np.ndarray, "N 3"]:
    """Centre line, x from the wall, from above to below; its ends are 8 mm inside the wall."""
    angle = np.linspace(np.pi / 2, -np.pi / 2, 22)
    cosine, sine = np.cos(angle), np.sin(angle)
    power = _POWER[curve]
    radius = (np.abs(cosine) ** power + np.abs(sine) ** power) ** (-1 / power)
    x, y = reach * radius * cosine, radius * sine
    if curve == "ear":
        x = x * (1 + 0.3 * y)
    height = (top + bottom) / 2 + (top - bottom) / 2 * y
    inside = -np.linspace(0.008, 0.002, 2)
    x = np.concatenate([inside, x, inside[::-1]])
    height = np.concatenate([height[:1]] * 2 + [height] + [height[-1:]] * 2)
    if curve == "hook":  # the lower end hangs free
        x, height = x[:-6], height[:-6]
    return np.column_stack([x, height, np.zeros_like(x)])


def _wall_chord(
    path: Float[np.ndarray, "N 3"], wall: Float[np.ndarray, "M 2"], curve: str
) -> Float[np.ndarray, "N"]:
    """Radius of the wall at the upper end, passing over to that at the lower end."""
    radius = np.interp(path[[0, -1], 1], wall[:, 1], wall[:, 0])
    if curve == "hook":
        radius[1] = radius[0]
    along = np.clip((path[:, 1] - path[0, 1]) / (path[-1, 1] - path[0, 1]), 0, 1)
    return radius[0] + (radius[1] - radius[0]) * along


def _thickening(draw: Draw, count: int) -> Float[np.ndarray, "N"]:
    """Thicker towards the wall, or not."""
    extra = draw.uniform("handle_root", 0.0, 0.5)
    return 1 + extra * np.abs(np.linspace(-1, 1, count)) ** 4
