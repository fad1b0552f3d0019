"""The 21 YCB-Video objects: their sizes, the frame that the network knows them in, and their scans.

The object frame is YCB-Video's turned so that y is up, with the middle of the box as its origin:
x stays, YCB-Video's z is y, its −y is z. So it is that of every other object here: metric, y up,
centred. This module alone knows about YCB-Video's and the scans' own axes.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from robust6dof.errors import DataError
from robust6dof.shapes.loading import load_mesh
from robust6dof.shapes.mesh import Material, ObjectModel, TexturedMesh
from robust6dof.shapes.ycb_shapes import ycb_shape

R_YCBV_OBJ = np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])
"""From this package's axes of an object to YCB-Video's."""

YCB_SIDES_M: dict[str, tuple[float, float, float]] = {
    "002_master_chef_can": (0.1020, 0.1400, 0.1022),
    "003_cracker_box": (0.0717, 0.2134, 0.1637),
    "004_sugar_box": (0.0493, 0.1759, 0.0940),
    "005_tomato_soup_can": (0.0671, 0.1016, 0.0674),
    "006_mustard_bottle": (0.0970, 0.1912, 0.0664),
    "007_tuna_fish_can": (0.0850, 0.0332, 0.0851),
    "008_pudding_box": (0.1376, 0.0387, 0.1278),
    "009_gelatin_box": (0.0889, 0.0300, 0.1008),
    "010_potted_meat_can": (0.1015, 0.0833, 0.0592),
    "011_banana": (0.1086, 0.0366, 0.1783),
    "019_pitcher_base": (0.1488, 0.2423, 0.1440),
    "021_bleach_cleanser": (0.1021, 0.2505, 0.0676),
    "024_bowl": (0.1605, 0.0548, 0.1599),
    "025_mug": (0.1160, 0.0812, 0.0929),
    "035_power_drill": (0.1840, 0.0570, 0.1870),
    "036_wood_block": (0.1037, 0.2057, 0.1033),
    "037_scissors": (0.0960, 0.0154, 0.2013),
    "040_large_marker": (0.0210, 0.0188, 0.1207),
    "051_large_clamp": (0.1197, 0.0389, 0.1708),
    "052_extra_large_clamp": (0.2094, 0.0361, 0.1640),
    "061_foam_brick": (0.0523, 0.0510, 0.0777),
}
"""Sides of the box along x, y and z of the object frame [m], in the order of YCB_OBJECTS."""

_SCAN_YAW_DEG = {"036_wood_block": 12.162}
"""Turn of the scan about its upward axis against YCB-Video's; the others differ by a shift alone
(measured by point-to-plane registration of the official points to the scans)."""


def known_extents(category: str) -> Float[np.ndarray, "3"] | None:
    """Sides of a YCB object's box [m]; None for anything else."""
    sides = YCB_SIDES_M.get(category)
    return None if sides is None else np.array(sides)


def make_ycb_stand_in(name: str) -> ObjectModel:
    """A simple solid of the object's size, in the object frame; what its prior is sampled from."""
    part = ycb_shape(name)
    low, high = part.vertices.min(axis=0), part.vertices.max(axis=0)
    vertices = (part.vertices - (low + high) / 2) * (np.array(YCB_SIDES_M[name]) / (high - low))
    grey = np.full((1, 1, 3), 160, np.uint8)
    return ObjectModel(TexturedMesh(vertices, part.faces, part.uv, grey), name, f"{name}_stand_in")


def find_ycb_scan(folder: str | Path, name: str) -> Path:
    """NAME/textured.obj or NAME/google_16k/textured.obj.

    Raises:
        DataError: there is neither.
    """
    home = Path(folder) / name
    for path in (home / "textured.obj", home / "google_16k" / "textured.obj"):
        if path.is_file():
            return path
    raise DataError(
        home, "no scan of this object", f"Put YCB's google_16k/textured.obj into {name}/"
    )


def load_ycb_scan(folder: str | Path, name: str) -> ObjectModel:
    """The scanned object (google_16k) in the object frame.

    Args:
        folder: of the scans; see `find_ycb_scan`.
        name: one of YCB_OBJECTS.

    Raises:
        DataError: no such file, or not a mesh.
    """
    mesh = load_mesh(find_ycb_scan(folder, name))
    R_scan_ycbv = Rotation.from_euler("z", _SCAN_YAW_DEG.get(name, 0.0), degrees=True).as_matrix()
    vertices = mesh.vertices @ R_scan_ycbv @ R_YCBV_OBJ
    vertices = vertices - (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    turned = TexturedMesh(vertices, mesh.faces, mesh.uv, mesh.texture, Material(0.1, 20.0))
    return ObjectModel(turned, name, name)
