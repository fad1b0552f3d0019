"""Laptops: a base with a keyboard and a lid opened by some angle, hinge towards −x."""

from __future__ import annotations

import numpy as np

from robust6dof.shapes.atlas import pack
from robust6dof.shapes.camera import FACING_X
from robust6dof.shapes.draw import Draw
from robust6dof.shapes.loft import box
from robust6dof.shapes.mesh import ObjectModel
from robust6dof.shapes.solid import finish, union
from robust6dof.shapes.textures import grain, material, pattern, solid

LYING = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]])
"""Turns a box's front (z) up, its right (x) to −z, its up (y) to −x: as the user sees it."""


def make_laptop(draw: Draw) -> ObjectModel:
    shade = np.full(3, draw.rng.choice([25, 60, 180, 215]), np.uint8)
    atlas = pack(
        {
            "keyboard": _keyboard(draw, shade),
            "screen": pattern(draw, "screen", 96, 192),
            "shell": grain(solid(shade, 32, 32), draw.rng),
        }
    )
    width = draw.uniform("width", 0.26, 0.4)
    depth = width * draw.uniform("depth_over_width", 0.6, 0.75)
    base_thickness = draw.uniform("base_thickness", 0.009, 0.026)
    lid_thickness = draw.uniform("lid_thickness", 0.004, 0.009)
    angle = np.radians(draw.uniform("angle_deg", 75, 155) - 90)
    corner = draw.uniform("corner", 0.002, 0.015)
    shell = atlas["shell"]
    base = box(
        (width, depth, base_thickness),
        corner,
        0.3 * base_thickness,
        (atlas["keyboard"], shell, shell),
    )
    lid = box(
        (width, depth, lid_thickness), corner, 0.3 * lid_thickness, (atlas["screen"], shell, shell)
    )
    tilt = np.array(
        [[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1.0]]
    )
    hinge = np.array([-depth / 2 + lid_thickness / 2, base_thickness / 2 - 0.002, 0])
    middle = tilt @ np.array([0.0, depth / 2, 0])
    parts = [base.moved(LYING), lid.moved(tilt @ FACING_X, hinge + middle)]
    return finish(union(parts), atlas, material(draw), "laptop", draw)


def _keyboard(draw: Draw, shade: np.ndarray) -> np.ndarray:
    image = solid(shade, 112, 192)
    key = np.full(3, draw.rng.choice([20, 40, 230]), np.uint8)
    for row in range(5):
        for column in range(13):
            image[10 + row * 11 : 19 + row * 11, 12 + column * 13 : 23 + column * 13] = key
    image[72:104, 70:122] = np.clip(shade * 0.85, 0, 255).astype(np.uint8)
    return grain(image, draw.rng)
