"""Cameras: a body, a lens towards +x, a hump, a grip and a shutter button."""

from __future__ import annotations

import numpy as np

from robust6dof.shapes.atlas import pack
from robust6dof.shapes.draw import Draw
from robust6dof.shapes.loft import box, revolve, rounded
from robust6dof.shapes.mesh import ObjectModel
from robust6dof.shapes.solid import finish, union
from robust6dof.shapes.textures import grain, material, random_color, solid

FACING_X = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
"""Turns a box's front (z) to +x, its right (x) to −z."""
UP_TO_X = np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
"""Turns a lathe's axis (y) to +x."""


def make_camera(draw: Draw) -> ObjectModel:
    """A union of a rounded box, a stepped lens and what sits on the body."""
    color = (
        random_color(draw.rng)
        if draw.chance("coloured", 0.3)
        else np.full(3, draw.rng.integers(15, 60), np.uint8)
    )
    atlas = pack(
        {
            "body": grain(solid(color, 64, 64), draw.rng, 12.0),
            "lens": grain(solid(np.full(3, 30, np.uint8), 16, 32), draw.rng, 5.0),
            "glass": solid(np.array([20, 15, 45], np.uint8)),
        }
    )
    width = draw.uniform("width", 0.09, 0.155)
    height = width * draw.uniform("height_over_width", 0.5, 0.75)
    depth = width * draw.uniform("depth_over_width", 0.2, 0.5)
    body = box((width, height, depth), 0.2 * height, 0.1 * depth, atlas["body"])
    lens_radius = height * draw.uniform("lens_radius_over_height", 0.25, 0.45)
    length = width * draw.uniform("lens_length_over_width", 0.1, 0.7)
    offset = width * draw.uniform("lens_offset_over_width", -0.2, 0.05)
    tube = rounded(
        np.array(
            [
                [0, -0.3 * depth],
                [lens_radius, -0.3 * depth],
                [lens_radius, length],
                [0.9 * lens_radius, length],
                [0.8 * lens_radius, length - 0.004],
            ]
        ),
        0.002,
    )
    glass = np.array(
        [
            [0.8 * lens_radius, length - 0.004],
            [0.4 * lens_radius, length - 0.002],
            [0, length - 0.001],
        ]
    )
    lens = revolve([(tube, atlas["lens"]), (glass, atlas["glass"])]).moved(
        UP_TO_X, (depth / 2, 0, offset)
    )
    parts = [body.moved(FACING_X), lens]
    if draw.chance("hump", 0.5):
        hump = box((0.35 * width, 0.3 * height, 0.8 * depth), 0.1 * height, 0.004, atlas["body"])
        parts.append(hump.moved(FACING_X, (0.05 * depth, 0.55 * height, offset)))
    return finish(union(parts), atlas, material(draw), "camera", draw)
