"""Draw a contact sheet of procedural objects, or of meshes in a folder: one row a category.

View from (+x, +y, +z); x red, y green, z blue.

    python benchmarks/contact_sheet.py --out contact_sheet.png
    python benchmarks/contact_sheet.py --meshes DIR --out scanned.png
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import tyro

from robust6dof.frames import CATEGORIES
from robust6dof.rendering.rasteriser import render
from robust6dof.rendering.scene import Camera, Light, MeshInstance, Scene
from robust6dof.shapes.mesh import ObjectModel
from robust6dof.shapes.procedural import make_object
from robust6dof.visualization.overlay import draw_box_and_axes

TILE_PX = 220


@dataclass(frozen=True)
class Options:
    out: Path
    """PNG to write."""
    count: int = 8
    """Objects of each category."""
    first: int = 0
    """First seed."""
    categories: tuple[str, ...] = CATEGORIES
    azimuth_deg: float = 45.0
    """From +x towards +z."""
    elevation_deg: float = 32.0
    meshes: Path | None = None
    """Draw these (DIR/category/file) instead."""
    axes: bool = True


def view(azimuth_deg: float, elevation_deg: float, distance: float) -> np.ndarray:
    """T_world_cam of a camera that looks at the origin, image up along +y."""
    azimuth, elevation = np.radians([azimuth_deg, elevation_deg])
    back = np.array(
        [
            np.cos(elevation) * np.cos(azimuth),
            np.sin(elevation),
            np.cos(elevation) * np.sin(azimuth),
        ]
    )
    right = np.cross(-back, [0, 1, 0])
    right /= np.linalg.norm(right)
    T_world_cam = np.eye(4)
    T_world_cam[:3, :3] = np.column_stack([right, np.cross(-back, right), -back])
    T_world_cam[:3, 3] = distance * back
    return T_world_cam


def tile(made: ObjectModel, options: Options) -> np.ndarray:
    """One object, as large as the tile allows."""
    distance = 3.0 * made.scale
    focal = 2.7 * TILE_PX
    K = np.array([[focal, 0, TILE_PX / 2], [0, focal, TILE_PX / 2], [0, 0, 1]])
    T_world_cam = view(options.azimuth_deg, options.elevation_deg, distance)
    towards = np.array([-0.5, -1.0, -0.2]) / np.linalg.norm([0.5, 1.0, 0.2])
    scene = Scene(
        [MeshInstance(made.mesh, np.eye(4), 1)],
        [Light(towards, (0.6, 0.6, 0.6)), Light(np.array([-0.3, -0.3, -0.9]), (0.3, 0.3, 0.3))],
        background=(225, 225, 225),
    )
    rgb = render(scene, Camera(K, TILE_PX, TILE_PX, T_world_cam)).rgb
    if options.axes:
        T_cam_obj = np.linalg.inv(T_world_cam)
        rgb = draw_box_and_axes(rgb, K, T_cam_obj, made.extents, (200, 200, 200), thickness=1)
    text = " ".join(f"{1000 * side:.0f}" for side in made.extents) + " mm"
    cv2.putText(rgb, text, (4, 14), cv2.FONT_HERSHEY_SIMPLEX, 0.42, (0, 0, 0), 1, cv2.LINE_AA)
    return rgb


def objects(options: Options) -> Sequence[Sequence[ObjectModel]]:
    """One row of objects for each category."""
    if options.meshes is not None:
        from robust6dof.shapes.loading import load_objects

        loaded = load_objects(options.meshes)
        return [models[: options.count] for models in loaded.values()]
    seeds = range(options.first, options.first + options.count)
    return [[make_object(category, seed) for seed in seeds] for category in options.categories]


def main(options: Options) -> None:
    rows = []
    for models in objects(options):
        tiles = [tile(made, options) for made in models]
        blank = np.full((TILE_PX, TILE_PX, 3), 225, np.uint8)
        rows.append(np.hstack(tiles + [blank] * (options.count - len(tiles))))
    cv2.imwrite(str(options.out), cv2.cvtColor(np.vstack(rows), cv2.COLOR_RGB2BGR))


if __name__ == "__main__":
    main(tyro.cli(Options, description=__doc__))
