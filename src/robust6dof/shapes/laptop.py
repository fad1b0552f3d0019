"""Laptops: a base with a keyboard and a lid opened by some angle, hinge towards −x."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from robust6dof.shapes.atlas import Atlas, pack
from robust6dof.shapes.draw import Draw
from robust6dof.shapes.labels import keyboard, lid_back, screen
from robust6dof.shapes.loft import Part, box, revolve
from robust6dof.shapes.mesh import ObjectModel
from robust6dof.shapes.solid import finish, union
from robust6dof.shapes.textures import Color, grain, grey, material, near, random_color, solid

LYING = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]])
"""Turns a box's front (z) up, its right (x) to −z, its up (y) to −x: as the user sees it."""
STANDING = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])
"""Turns a box's front (z) to +x, its right (x) to −z."""
_ALONG_Z = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])


def make_laptop(draw: Draw) -> ObjectModel:
    """A base, perhaps thinner in front, a lid turned about the hinge, and the hinge's barrels."""
    atlas = pack(_images(draw))
    width = draw.uniform("width", 0.24, 0.40)
    depth = width * draw.uniform("depth_over_width", 0.58, 0.78)
    thick = draw.uniform("base_thickness", 0.008, 0.034)
    lid_thick = draw.uniform("lid_thickness", 0.004, 0.011)
    corner = draw.uniform("corner", 0.001, 0.018)
    tilt = _tilt(draw.uniform("angle_deg", 70.0, 165.0))
    size = (width, depth, thick)
    bevel = 0.5 * thick * draw.uniform("bevel", 0.1, 0.9)
    base = box(size, corner, bevel, (atlas["keyboard"], atlas["shell"], atlas["bottom"]))
    base = _wedge(base.moved(LYING), thick, draw.uniform("front_over_back", 0.45, 1.0))
    tall = depth * draw.uniform("lid_over_base", 0.93, 1.0)
    lid = box(
        (width, tall, lid_thick),
        corner,
        0.4 * lid_thick,
        (atlas["screen"], atlas["shell"], atlas["back"]),
    )
    axis = np.array([-depth / 2 + max(0.8 * lid_thick, bevel), thick / 2 + 0.15 * lid_thick, 0.0])
    gap = draw.uniform("hinge_gap", 0.0, 0.006)
    middle = tilt @ np.array([-0.25 * lid_thick, tall / 2 + gap, 0.0])
    hinges = _hinges(draw, width, lid_thick, gap, axis, atlas)
    parts = [base, lid.moved(tilt @ STANDING, axis + middle), *hinges]
    return finish(union(parts), atlas, material(draw, matt=0.5), "laptop", draw)


def _images(draw: Draw) -> dict[str, np.ndarray]:
    shade = _shade(draw)
    inner = shade if draw.chance("deck_as_shell", 0.7) else _shade(draw)
    return {
        "keyboard": grain(keyboard(draw.rng, 88, 192, inner), draw.rng),
        "screen": screen(draw.rng, 88, 192),
        "back": grain(lid_back(draw.rng, 64, 112, shade), draw.rng),
        "shell": grain(solid(inner, 64, 40), draw.rng),
        "bottom": solid(near(shade, draw.rng, 15), 64, 40),
    }


def _shade(draw: Draw) -> Color:
    """Black, grey, silver or white; sometimes a colour."""
    if draw.rng.random() < 0.12:
        return random_color(draw.rng)
    return near(grey(draw.rng.choice([15, 40, 90, 170, 205, 235])), draw.rng, 6)


def _tilt(angle_deg: float) -> Float[np.ndarray, "3 3"]:
    """Turns the upright lid about z so that it stands at the given angle to the keyboard."""
    back = np.radians(angle_deg - 90.0)
    cosine, sine = np.cos(back), np.sin(back)
    return np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])


def _wedge(base: Part, thick: float, front_over_back: float) -> Part:
    """The bottom rises towards the front (+x)."""
    vertices = base.vertices.copy()
    x = vertices[:, 0]
    share = (x - x.min()) / np.ptp(x)
    scale = 1 + share * (front_over_back - 1)
    vertices[:, 1] = thick / 2 - (thick / 2 - vertices[:, 1]) * scale
    return Part(vertices, base.faces, base.uv)


def _hinges(
    draw: Draw,
    width: float,
    lid_thick: float,
    gap: float,
    axis: Float[np.ndarray, "3"],
    atlas: Atlas,
) -> list[Part]:
    """One wide barrel or two narrow ones about the hinge's axis."""
    radius = max(0.6 * lid_thick, gap + 0.0015)
    long = draw.chance("one_hinge", 0.4)
    length = width * (draw.uniform("hinge_length", 0.4, 0.9) if long else 0.1)
    barrel = revolve(
        [
            (np.array([[0, -length / 2], [radius, -length / 2]]), atlas["bottom"]),
            (np.array([[radius, -length / 2], [radius, length / 2]]), atlas["bottom"]),
            (np.array([[radius, length / 2], [0, length / 2]]), atlas["bottom"]),
        ],
        count=16,
    )
    places = [0.0] if long else [-0.33 * width, 0.33 * width]
    return [barrel.moved(_ALONG_Z, axis + [0, 0, z]) for z in places]
