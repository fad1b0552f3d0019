"""Cans: drink cans with a neck, food cans with rims and ribs, tall and flat ones."""

from __future__ import annotations

import numpy as np

from robust6dof.shapes.atlas import pack
from robust6dof.shapes.draw import Draw
from robust6dof.shapes.loft import revolve, rounded
from robust6dof.shapes.mesh import ObjectModel
from robust6dof.shapes.solid import finish
from robust6dof.shapes.textures import grain, material, metal, pattern, solid


def make_can(draw: Draw) -> ObjectModel:
    """One lathe profile: domed bottom, side, rim, recessed lid."""
    steel = metal(draw.rng)
    images = {
        "side": pattern(draw, "wrap", 160, 256),
        "lid": grain(solid(steel, 32, 32), draw.rng, 6.0),
        "bottom": grain(solid(steel, 16, 16), draw.rng, 6.0),
    }
    atlas = pack(images)
    radius = draw.uniform("radius", 0.025, 0.045)
    height = 2 * radius * draw.uniform("height_over_diameter", 0.75, 2.7)
    neck = draw.uniform("neck", 0.0, 0.16) * radius
    rise = max(neck * 1.2, 0.001)
    rim, recess = 0.0015, draw.uniform("lid_recess", 0.002, 0.006)
    top = radius - neck
    bottom = rounded(
        np.array(
            [
                [0, 0.004],
                [0.7 * (radius - neck), 0.0035],
                [0.85 * (radius - neck), 0],
                [top, 0.0008],
            ]
        ),
        0.001,
    )
    side = rounded(
        np.array(
            [
                [top, 0.0008],
                [radius, 0.0008 + rise],
                [radius, height - rise - 0.003],
                [top, height - 0.003],
            ]
        ),
        0.004,
    )
    lid = rounded(
        np.array(
            [
                [top, height - 0.003],
                [top + rim, height - 0.0025],
                [top + rim, height],
                [top - rim, height],
                [top - 1.5 * rim, height - recess],
                [0, height - recess],
            ]
        ),
        0.0007,
        2,
    )
    part = revolve([(bottom, atlas["bottom"]), (side, atlas["side"]), (lid, atlas["lid"])])
    return finish(part, atlas, material(draw, matt=0.2), "can", draw)
