"""Small recordings for the data tests."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from robust6dof.data.sequence_writer import write_sequence
from robust6dof.frames import RgbdFrame
from robust6dof.geometry.transforms import make_transform

WIDTH, HEIGHT = 64, 48
K = np.array([[60.0, 0.0, 31.5], [0.0, 61.0, 23.5], [0.0, 0.0, 1.0]])


def make_frame(index: int = 0, name: str = "", stamp: float | None = None) -> RgbdFrame:
    """A slanted surface 0.8 m away with one invalid pixel, and colour that tells frames apart."""
    y, x = np.mgrid[:HEIGHT, :WIDTH]
    depth = (0.8 + 0.002 * x + 0.001 * y + 0.01 * index).astype(np.float32)
    depth[0, 0] = 0.0
    rgb = np.stack([4 * x, 5 * y, np.full_like(x, 10 * index)], axis=-1).astype(np.uint8)
    return RgbdFrame(rgb, depth, K, stamp, name)


def make_mask(index: int = 0) -> np.ndarray:
    mask = np.zeros((HEIGHT, WIDTH), dtype=bool)
    mask[10:20, 20 + index : 40 + index] = True
    return mask


def make_T_cam_obj(index: int = 0) -> np.ndarray:
    angle = 0.1 * index
    R = [[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]]
    return make_transform(np.array(R), np.array([0.01 * index, 0.02, 0.85]))


def make_recording(path: Path, count: int = 3) -> Path:
    """Write `count` frames whose names are not consecutive, with masks and poses."""
    frames = [make_frame(i, name=str(97 + 3 * i)) for i in range(count)]
    masks = [make_mask(i) for i in range(count)]
    write_sequence(path, frames, masks, [make_T_cam_obj(i) for i in range(count)])
    return path
