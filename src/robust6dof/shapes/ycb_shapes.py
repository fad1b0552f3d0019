"""Simple solids of the 21 YCB-Video objects: what their priors are made of.

Made by hand from lathes, boxes and tubes, then stretched to the object's known sides; no scan went
into them. Axes are those of `ycb_objects`; outlines below are in millimetres.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from robust6dof.shapes.atlas import Slot
from robust6dof.shapes.loft import ROUND, Part, Section, box, revolve, sweep
from robust6dof.shapes.solid import union

_PLAIN = Slot(0.0, 0.0, 1.0, 1.0)
_UPRIGHT = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
"""A solid built along z stands along y; one drawn in x–y lies in x–z, what was y towards −z."""
_LYING = _UPRIGHT.T
"""One drawn in x–y lies in x–z, what was y towards +z."""

Outline = Sequence[tuple[float, float]]


def ycb_shape(name: str) -> Part:
    """A closed solid like the object, of about its size [m]; `ycb_objects` knows the exact one."""
    return _MAKERS[name]()


def _lathe(profile: Outline, section: Section = ROUND, yaw_deg: float = 0.0) -> Part:
    """A profile of (radius, height) [mm] turned about y."""
    bands = [(np.array(profile) / 1000, _PLAIN)]
    return revolve(bands, section).moved(_about_y(yaw_deg))


def _cylinder(radius: float, height: float) -> Part:
    return _lathe([(0, 0), (radius, 0), (radius, height), (0, height)])


def _block(
    sides: tuple[float, float, float],
    place: tuple[float, float, float] = (0, 0, 0),
    yaw_deg: float = 0.0,
) -> Part:
    """A box with sides x, y, z [mm], turned about y, its middle at `place`."""
    x, y, z = (side / 1000 for side in sides)
    return box((x, y, z), 0.001, 0.001, _PLAIN, steps=1).moved(
        _about_y(yaw_deg), np.array(place) / 1000
    )


def _tube(path: Outline, thickness: Sequence[float] | float, height: float, y: float = 0.0) -> Part:
    """A tube along (x, z) points [mm] that lies flat: this thick across, this high along y."""
    corners = np.array(path, dtype=float)
    at = np.linspace(0, len(corners) - 1, 8 * (len(corners) - 1) + 1)
    number = np.arange(len(corners))
    line = np.stack([np.interp(at, number, column) for column in corners.T], axis=1)
    across = np.interp(at, number, np.broadcast_to(np.array(thickness, dtype=float), number.shape))
    widths = np.stack([across, np.minimum(across * height / across.max(), height)], axis=1) / 2000
    centre_line = np.column_stack([line, np.zeros(len(line))]) / 1000
    return sweep(centre_line, widths, _PLAIN).moved(_LYING, (0, y / 1000, 0))


def _about_y(degrees: float) -> Float[np.ndarray, "3 3"]:
    return Rotation.from_euler("y", degrees, degrees=True).as_matrix()


def _mustard_bottle() -> Part:
    profile = [(0, 0), (44, 0), (47, 8), (43, 60), (48, 110), (44, 140), (26, 158), (17, 160)]
    top = [(17, 172), (9, 174), (7, 191), (0, 191)]
    section = Section(2.6, 0.6, round_radius=0.017, full_radius=0.04)
    return _lathe([*profile, *top], section, yaw_deg=-25)


def _bleach_cleanser() -> Part:
    profile = [(0, 0), (49, 0), (51, 8), (51, 140), (40, 185), (28, 208), (14, 222), (14, 250)]
    section = Section(2.8, 0.66, round_radius=0.014, full_radius=0.04)
    part = _lathe([*profile, (0, 250)], section)
    # The neck stands off the middle.
    height = part.vertices[:, 1]
    lean = np.interp(height, [0.14, 0.21], [0.0, 0.01])
    return Part(part.vertices + np.outer(lean, [1, 0, 0]), part.faces, part.uv)


def _potted_meat_can() -> Part:
    return box((0.1015, 0.0592, 0.0833), 0.022, 0.002, _PLAIN).moved(_UPRIGHT)


def _banana() -> Part:
    path = [(-30, 88), (-39, 62), (-40, 20), (-28, -25), (-5, -58), (22, -78), (52, -84)]
    return _tube(path, [10, 24, 34, 36, 34, 22, 10], 37)


def _pitcher() -> Part:
    wall = [(0, 0), (54, 0), (66, 232), (70, 242), (60, 236), (0, 236)]
    body = _lathe(wall).moved(np.eye(3), (-0.008, 0, 0.01))
    curve = np.array([[55, 222], [98, 220], [106, 190], [100, 120], [85, 75], [58, 72]]) / 1000
    path = np.column_stack([curve, np.zeros(len(curve))])
    widths = np.tile([0.008, 0.012], (len(curve), 1))
    handle = sweep(path, widths, _PLAIN).moved(_about_y(41), (-0.008, 0, 0.01))
    spout = _block((30, 30, 30), (-58, 225, 60), yaw_deg=45)
    return union([body, handle, spout])


def _bowl() -> Part:
    outside = [(0, 0), (40, 0), (62, 18), (74, 38), (80, 55)]
    inside = [(77, 55), (71, 38), (59, 20), (38, 4), (0, 4)]
    return _lathe([*outside, *inside])


def _mug() -> Part:
    outside = [(0, 0), (40, 0), (43, 5), (43, 76), (46, 81)]
    body = _lathe([*outside, (41, 78), (40, 5), (0, 5)]).moved(np.eye(3), (-0.012, 0, 0))
    curve = np.array([[29, 66], [52, 64], [56, 42], [50, 20], [29, 14]]) / 1000
    path = np.column_stack([curve, np.zeros(len(curve))])
    handle = sweep(path, np.tile([0.004, 0.007], (len(curve), 1)), _PLAIN)
    return union([body, handle])


def _power_drill() -> Part:
    motor = _tube([(-46, -70), (-30, -70), (75, -70), (90, -68)], [36, 52, 56, 38], 54)
    chuck = _tube([(-92, -70), (-80, -70), (-40, -70)], [12, 36, 40], 40)
    grip = _tube([(45, -60), (35, 0), (22, 68)], [46, 40, 44], 40)
    trigger = _block((28, 26, 34), (12, 0, -28))
    battery = _block((106, 52, 38), (30, 0, 74))
    return union([motor, chuck, grip, trigger, battery])


def _scissors() -> Part:
    return union(
        [
            _tube(_ring(-32, 55, 16, 22), 9, 13),
            _tube(_ring(18, 68, 16, 30), 9, 13),
            _tube([(-22, 36), (0, 12), (20, -10)], [10, 14, 16], 12),
            _tube([(12, 40), (12, 12), (16, -10)], [10, 12, 16], 12),
            _tube([(14, -5), (32, -50), (46, -100)], [22, 15, 4], 5),
        ]
    )


def _ring(x: float, z: float, half_width: float, half_length: float) -> Outline:
    """An ellipse of (x, z) points, all but closed."""
    turns = np.linspace(0, 1.94 * np.pi, 14)
    return [(x + half_width * np.cos(turn), z + half_length * np.sin(turn)) for turn in turns]


def _marker() -> Part:
    """It lies along z, its cap towards −z."""
    profile = [(0, -60), (5, -60), (9.4, -56), (9.4, 52), (5, 54), (5, 60), (0, 60)]
    return _lathe(profile).moved(_LYING)


def _large_clamp() -> Part:
    return union(
        [
            _tube([(-56, -66), (-30, -32), (10, 2), (16, 12)], [14, 17, 18, 16], 20),
            _tube([(54, -84), (40, -48), (14, 0), (8, 12)], [14, 17, 18, 16], 20),
            _tube([(12, 0), (-6, 24), (2, 56), (20, 84)], [16, 14, 15, 10], 18),
            _tube([(12, 0), (42, 20), (42, 50), (24, 84)], [16, 14, 15, 10], 18),
            _lathe([(0, -19), (10, -19), (10, 19), (0, 19)]).moved(np.eye(3), (0.012, 0, 0.004)),
        ]
    )


def _extra_large_clamp() -> Part:
    return union(
        [
            _tube([(98, 76), (40, 34), (-4, 8), (-14, 2)], [14, 19, 20, 16], 20),
            _tube([(80, -76), (40, -38), (0, 4), (-12, 12)], [14, 19, 20, 16], 20),
            _tube([(0, 8), (-36, 38), (-72, 36), (-102, 18)], [18, 16, 17, 10], 18),
            _tube([(0, 4), (-34, -24), (-66, -16), (-102, 14)], [18, 16, 17, 10], 18),
            _lathe([(0, -18), (11, -18), (11, 18), (0, 18)]).moved(np.eye(3), (0, 0, 0.006)),
        ]
    )


_MAKERS: dict[str, Callable[[], Part]] = {
    "002_master_chef_can": partial(_cylinder, 51, 140),
    "003_cracker_box": partial(_block, (71.7, 213.4, 163.7)),
    "004_sugar_box": partial(_block, (49.3, 175.9, 94.0)),
    "005_tomato_soup_can": partial(_cylinder, 33.8, 101.6),
    "006_mustard_bottle": _mustard_bottle,
    "007_tuna_fish_can": partial(_cylinder, 42.5, 33.2),
    "008_pudding_box": partial(_block, (112, 38.7, 89), yaw_deg=25),
    "009_gelatin_box": partial(_block, (73, 30, 88), yaw_deg=14),
    "010_potted_meat_can": _potted_meat_can,
    "011_banana": _banana,
    "019_pitcher_base": _pitcher,
    "021_bleach_cleanser": _bleach_cleanser,
    "024_bowl": _bowl,
    "025_mug": _mug,
    "035_power_drill": _power_drill,
    "036_wood_block": partial(_block, (89, 205.7, 89), yaw_deg=-12),
    "037_scissors": _scissors,
    "040_large_marker": _marker,
    "051_large_clamp": _large_clamp,
    "052_extra_large_clamp": _extra_large_clamp,
    "061_foam_brick": partial(_block, (52.3, 51.0, 77.7)),
}
