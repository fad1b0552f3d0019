"""NOCS images in exactly the published formats, of objects whose poses are known."""

from __future__ import annotations

import pickle
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from robust6dof.data.image_files import write_image
from robust6dof.geometry.transforms import make_transform

HEIGHT, WIDTH = 480, 640


@dataclass
class Instance:
    """A box facing the camera whose front shows in a rectangle of the image."""

    instance_id: int
    class_id: int
    model: str
    T_cam_obj: np.ndarray
    extents: np.ndarray
    rows: slice
    columns: slice
    in_mask: bool = True

    @property
    def scale(self) -> float:
        return float(np.linalg.norm(self.extents))

    @property
    def RT(self) -> np.ndarray:
        RT = self.T_cam_obj.copy()
        RT[:3, :3] *= self.scale
        return RT

    @property
    def box(self) -> list[int]:
        return [self.rows.start, self.columns.start, self.rows.stop, self.columns.stop]


def make_instances() -> list[Instance]:
    """Listed, as in the data set, in another order than by id; 4 is listed but not in view."""
    rotation = Rotation.from_euler("xyz", [[0.1, 0.5, 3.0], [0.3, -1.0, 2.9], [0, 2.0, 3.1]])
    R = rotation.as_matrix()
    mug, bowl = np.array([0.12, 0.1, 0.09]), np.array([0.16, 0.07, 0.16])
    return [
        Instance(
            *(3, 6, "mug_anastasia_norm", make_transform(R[0], np.array([-0.1, 0.05, 0.9])), mug),
            *(slice(250, 320), slice(200, 290)),
        ),
        Instance(
            *(2, 0, "distractor_norm", np.eye(4), bowl, slice(20, 60), slice(30, 90)),
        ),
        Instance(
            *(4, 1, "bottle_absent_norm", make_transform(R[2], np.array([0.0, 0.0, 1.5])), bowl),
            *(slice(0, 1), slice(0, 1), False),
        ),
        Instance(
            *(1, 2, "bowl_white_small_norm", make_transform(R[1], np.array([0.2, 0.1, 1.1])), bowl),
            *(slice(300, 360), slice(400, 500)),
        ),
    ]


def annotated(instances: list[Instance]) -> list[Instance]:
    """Those that the gts pickles hold, in their order."""
    kept = [one for one in instances if one.in_mask and one.class_id]
    return sorted(kept, key=lambda one: one.instance_id)


def write_frame(
    folder: Path, name: str, instances: list[Instance], camera: bool = False
) -> np.ndarray:
    """Write one image with mask, coordinates and meta file; returns its depth [mm]."""
    folder.mkdir(parents=True, exist_ok=True)
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    depth = (900 + x // 4 + y // 8).astype(np.uint16)
    depth[:5] = 0
    ids = np.full((HEIGHT, WIDTH), 255, np.uint8)
    coordinates = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    for one in instances:
        if one.in_mask:
            ids[one.rows, one.columns] = one.instance_id
            coordinates[one.rows, one.columns] = (10 * one.instance_id, 128, 200)
    rgb = np.stack([x % 256, y % 256, (x + y) % 256], axis=-1).astype(np.uint8)
    write_image(folder / f"{name}_color.png", rgb)
    write_image(folder / f"{name}_coord.png", coordinates)
    three = np.stack([ids, 255 - ids, np.zeros_like(ids)], axis=-1)
    write_image(folder / f"{name}_mask.png", three if camera else ids)
    if not camera:
        write_image(folder / f"{name}_depth.png", depth)
    middle = "02876657 " if camera else ""
    lines = [f"{one.instance_id} {one.class_id} {middle}{one.model}" for one in instances]
    (folder / f"{name}_meta.txt").write_text("\n".join(lines) + "\n")
    return depth


def write_camera_depth(path: Path, depth: np.ndarray) -> None:
    """CAMERA's encoding: G·256 + R, and 32001 where there is none."""
    values = np.where(depth == 0, 32001, depth).astype(np.uint16)
    encoded = np.stack([values % 256, values // 256, np.zeros_like(values)], axis=-1)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_image(path, encoded.astype(np.uint8))


def write_pickle(path: Path, content: Any) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(pickle.dumps(content, protocol=2))
