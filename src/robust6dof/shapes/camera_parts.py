"""What sits on a camera's body: lenses, dials, humps, grips, flashes."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from robust6dof.shapes.atlas import Atlas
from robust6dof.shapes.draw import Draw
from robust6dof.shapes.loft import Part, Section, box, revolve

FACING_X = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
"""Turns a box's front (z) to +x, its right (x) to −z."""
_UP_TO_X = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
"""Turns a lathe's axis (y) to +x."""


def lens(
    draw: Draw,
    radius: float,
    length: float,
    start: Float[np.ndarray, "3"],
    atlas: Atlas,
    sink: float,
) -> Part:
    """A stepped barrel along +x with a concave front and a glass.

    Args:
        draw: where the parameters come from.
        radius: largest radius [m].
        length: from the body's front [m].
        start: where its axis leaves the body [m].
        atlas: has the images "lens", "rim" and "glass".
        sink: how deep it reaches into the body [m].
    """
    steps = round(draw.uniform("lens_steps", 1, 4))
    widths = radius * _step_widths(draw, steps)
    ends = np.concatenate([[-sink], length * (np.arange(1, steps + 1) / steps) ** 1.3])
    profile = [[0.0, -sink], [widths[0], -sink]]
    for width, low, high in zip(widths, ends, ends[1:], strict=False):
        profile += [[width, low + 1e-4], [width - 4e-4, high]]
    front = widths[-1] - 4e-4
    glass = front * draw.uniform("glass_over_front", 0.45, 0.88)
    depth = min(0.6 * length, draw.uniform("lens_hollow", 0.001, 0.014))
    rim = [[front, length], [0.94 * front, length], [glass, length - depth]]
    bulge = 0.15 * glass
    pane = [[glass, length - depth], [0.6 * glass, length - depth + 0.6 * bulge]]
    pane.append([0.0, length - depth + bulge])
    bands = [(np.array(profile[1:]), atlas["lens"])]
    bands.insert(0, (np.array(profile[:2]), atlas["lens"]))
    bands += [(np.array(rim), atlas["rim"]), (np.array(pane), atlas["glass"])]
    return revolve(bands, count=40).moved(_UP_TO_X, start)


def _step_widths(draw: Draw, steps: int) -> Float[np.ndarray, "N"]:
    """Relative radii of the barrel's pieces, the largest 1."""
    kind = draw.choice("lens_profile", {"narrowing": 0.5, "even": 0.3, "widening": 0.2})
    last = draw.uniform("lens_narrow", 0.62, 0.92)
    ramp = np.linspace(1.0, last, steps)
    widths = {"narrowing": ramp, "even": np.full(steps, 1.0), "widening": ramp[::-1]}[kind]
    wave = 1 - 0.05 * (np.arange(steps) % 2)
    return widths * wave / (widths * wave).max()


def dial(radius: float, tall: float, place: Float[np.ndarray, "3"], atlas: Atlas) -> Part:
    """A knurled knob standing at a place on the top."""
    section = Section(2.0, 1.0, 20, 0.06, 0.0, 1e-6)
    profile = np.array([[0, -0.004], [radius, -0.004], [radius, tall], [0.0, tall]])
    bands = [(profile[:2], atlas["metal"]), (profile[1:3], atlas["knurl"])]
    bands.append((profile[2:], atlas["metal"]))
    return revolve(bands, section, count=40).moved(np.eye(3), place)


def prism(
    width: float, tall: float, deep: float, place: Float[np.ndarray, "3"], atlas: Atlas
) -> Part:
    """The hump over the lens: a box that narrows upwards; its foot is at the place."""
    hump = box((width, 2 * tall, deep), 0.3 * tall, 0.15 * deep, atlas["plate"])
    vertices = hump.vertices.copy()
    vertices[:, 0] *= 1 - 0.35 * np.clip(vertices[:, 1] / tall, 0, 1)
    vertices[:, 2] *= 1 - 0.2 * np.clip(vertices[:, 1] / tall, 0, 1)
    return Part(vertices, hump.faces, hump.uv).moved(FACING_X, place)


def grip(
    width: float, height: float, reach: float, place: Float[np.ndarray, "3"], atlas: Atlas
) -> Part:
    """The rounded handle in front of the body, at the place, as far as `reach` towards +x."""
    part = box((width, height, 2 * reach), 0.35 * width, 0.6 * reach, atlas["leather"])
    return part.moved(FACING_X, place)


def block(
    size: tuple[float, float, float], place: Float[np.ndarray, "3"], atlas: Atlas, image: str
) -> Part:
    """A small box facing +x: a viewfinder's window, a flash, a shoe."""
    small = 0.15 * min(size)
    slots = (atlas[image], atlas["plate"], atlas["plate"])
    return box(size, small, small, slots, steps=2).moved(FACING_X, place)
