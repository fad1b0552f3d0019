"""Bottles: round and flat bodies, shoulders, necks and caps; some with a handle."""

from __future__ import annotations

import numpy as np

from robust6dof.shapes.atlas import pack
from robust6dof.shapes.draw import Draw
from robust6dof.shapes.loft import Section, revolve, rounded
from robust6dof.shapes.mesh import ObjectModel
from robust6dof.shapes.solid import finish
from robust6dof.shapes.textures import material, pattern, random_color, solid


def make_bottle(draw: Draw) -> ObjectModel:
    """One lathe profile: base, body with a label, shoulder, neck, cap."""
    body_color = random_color(draw.rng)
    atlas = pack(
        {
            "label": pattern(draw, "label", 128, 256),
            "lower": solid(body_color),
            "upper": solid(body_color, 9, 8),
            "cap": solid(random_color(draw.rng), 10, 8),
        }
    )
    height = draw.uniform("height", 0.12, 0.32)
    radius = height * draw.uniform("width_over_height", 0.22, 0.45) / 2
    neck = radius * draw.uniform("neck_over_body", 0.2, 0.65)
    neck_start = height * draw.uniform("neck_start", 0.72, 0.9)
    shoulder = neck_start - height * draw.uniform("shoulder_height", 0.06, 0.22)
    label = sorted((height * 0.06 + 0.005, shoulder - 0.01))
    cap = height - (height - neck_start) * draw.uniform("cap_share", 0.3, 0.8)
    wide = neck * draw.uniform("cap_over_neck", 1.05, 1.3)
    lower = rounded(
        np.array(
            [[0, 0.003], [0.7 * radius, 0.003], [0.75 * radius, 0], [radius, 0], [radius, label[0]]]
        ),
        0.01,
    )
    middle = np.array([[radius, label[0]], [radius, label[1]]])
    upper = rounded(
        np.array(
            [
                [radius, label[1]],
                [radius, shoulder],
                [neck, neck_start],
                [neck, cap],
            ]
        ),
        0.03,
        6,
    )
    top = rounded(np.array([[neck, cap], [wide, cap], [wide, height], [0, height]]), 0.002, 2)
    section = Section(2.0, 1.0)
    if draw.chance("flat", 0.25):
        section = Section(
            draw.uniform("section_exponent", 2.0, 5.0),
            draw.uniform("depth_over_width", 0.5, 1.0),
            0,
            0.0,
            max(neck, wide),
            radius,
        )
    part = revolve(
        [
            (lower, atlas["lower"]),
            (middle, atlas["label"]),
            (upper, atlas["upper"]),
            (top, atlas["cap"]),
        ],
        section,
    )
    return finish(part, atlas, material(draw), "bottle", draw)
