"""Packs the images of an object's parts into its one texture."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, UInt8


@dataclass(frozen=True)
class Slot:
    """A rectangle of the texture, in texture coordinates."""

    u_min: float
    v_min: float
    u_max: float
    v_max: float

    def place(self, uv: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n 2"]:
        """Texture coordinates of a part's own coordinates in [0, 1]²."""
        low = np.array([self.u_min, self.v_min])
        return low + np.clip(uv, 0.0, 1.0) * (np.array([self.u_max, self.v_max]) - low)


@dataclass(frozen=True, eq=False)
class Atlas:
    """One texture image and where each part's image lies in it."""

    image: UInt8[np.ndarray, "H W 3"]
    slots: Mapping[str, Slot]

    def __getitem__(self, name: str) -> Slot:
        return self.slots[name]


def pack(images: Mapping[str, UInt8[np.ndarray, "_ _ 3"]]) -> Atlas:
    """Stack images side by side on shelves, tallest first, as wide as the widest.

    Slots end half a pixel inside their images, so that interpolation never mixes two of them.
    """
    width = max(image.shape[1] for image in images.values())
    corners: dict[str, tuple[int, int]] = {}
    left = top = shelf = 0
    for name in sorted(images, key=lambda key: (-images[key].shape[0], key)):
        rows, columns = images[name].shape[:2]
        if left + columns > width:
            left, top, shelf = 0, top + shelf, 0
        corners[name] = (top, left)
        left, shelf = left + columns, max(shelf, rows)
    canvas = np.zeros((top + shelf, width, 3), np.uint8)
    for name, (row, column) in corners.items():
        rows, columns = images[name].shape[:2]
        canvas[row : row + rows, column : column + columns] = images[name]
    return Atlas(
        canvas, {key: _slot(corners[key], images[key].shape, canvas.shape) for key in corners}
    )


def _slot(corner: tuple[int, int], shape: tuple[int, ...], canvas: tuple[int, ...]) -> Slot:
    (top, left), (rows, columns) = corner, shape[:2]
    height, width = canvas[:2]
    return Slot(
        u_min=(left + 0.5) / width,
        v_min=1 - (top + rows - 0.5) / height,
        u_max=(left + columns - 0.5) / width,
        v_max=1 - (top + 0.5) / height,
    )
