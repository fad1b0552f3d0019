"""What a mesh file says of its surface (texture, colours of vertices or faces) as image and uv."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
import trimesh
from jaxtyping import Float, Int, UInt8
from trimesh.visual.material import PBRMaterial

from robust6dof.shapes.atlas import pack

LARGEST_PX = 1024
"""Textures of files are shrunk to this side."""
DEFAULT_COLOR = (150, 150, 150)
"""Where a file gives no colour."""


@dataclass(frozen=True, eq=False)
class Painted:
    """A geometry with an image."""

    vertices: Float[np.ndarray, "V 3"]
    faces: Int[np.ndarray, "F 3"]
    uv: Float[np.ndarray, "V 2"]
    image: UInt8[np.ndarray, "H W 3"]


def paint(geometry: trimesh.Trimesh) -> Painted:
    """Texture and coordinates of one geometry; colours of vertices become colours of faces."""
    vertices = np.array(geometry.vertices, dtype=np.float64)
    faces = np.array(geometry.faces, dtype=np.int64)
    visual: Any = geometry.visual
    if visual.kind == "texture":
        image = _material_image(visual.material)
        uv = np.zeros((len(vertices), 2)) if visual.uv is None else np.array(visual.uv, np.float64)
        return Painted(vertices, faces, np.nan_to_num(uv), image)
    if visual.kind in ("vertex", "face"):
        colors = np.array(visual.face_colors)[:, :3].astype(np.uint8)
        return _paint_faces(vertices, faces, colors)
    plain = np.array([[DEFAULT_COLOR]], np.uint8)
    return Painted(vertices, faces, np.zeros((len(vertices), 2)), plain)


def merge(parts: list[Painted]) -> Painted:
    """Several geometries as one, their images packed into one."""
    if len(parts) == 1:
        return parts[0]
    tiled = [_untiled(part) for part in parts]
    largest = LARGEST_PX if len(parts) <= 4 else LARGEST_PX // 2
    images = {str(i): _shrunk(part.image, largest) for i, part in enumerate(tiled)}
    atlas = pack(images)
    offsets = np.cumsum([0] + [len(part.vertices) for part in tiled])
    return Painted(
        np.concatenate([part.vertices for part in tiled]),
        np.concatenate([part.faces + start for part, start in zip(tiled, offsets, strict=False)]),
        np.concatenate([atlas[str(i)].place(part.uv) for i, part in enumerate(tiled)]),
        _shrunk(atlas.image, 2 * LARGEST_PX),
    )


def _material_image(material: Any) -> UInt8[np.ndarray, "H W 3"]:
    """Base colour image times base colour of a glTF or OBJ material."""
    texture = getattr(material, "baseColorTexture", None)
    texture = getattr(material, "image", None) if texture is None else texture
    factor = _color_factor(material, textured=texture is not None)
    if texture is None:
        return (255 * factor + 0.5).astype(np.uint8).reshape(1, 1, 3)
    image = np.asarray(texture.convert("RGB"))
    return _shrunk((image * factor + 0.5).astype(np.uint8), LARGEST_PX)


def _color_factor(material: Any, *, textured: bool) -> Float[np.ndarray, "3"]:
    """glTF's factor is linear light (glTF 2.0, 3.9.2); OBJ's diffuse colour is taken as sRGB."""
    if isinstance(material, PBRMaterial):
        factor = material.baseColorFactor
        linear = np.ones(3) if factor is None else np.asarray(factor, float)[:3] / 255
        return linear ** (1 / 2.2)
    diffuse = getattr(material, "diffuse", None)
    if textured or diffuse is None:
        return np.ones(3) if textured else np.array(DEFAULT_COLOR) / 255
    return np.asarray(diffuse, float)[:3] / 255


def _paint_faces(
    vertices: Float[np.ndarray, "V 3"],
    faces: Int[np.ndarray, "F 3"],
    colors: UInt8[np.ndarray, "F 3"],
) -> Painted:
    """One texel for each face; its three corners all point at the texel's centre."""
    side = int(np.ceil(np.sqrt(len(faces))))
    image = np.zeros((side, side, 3), np.uint8)
    row, column = np.divmod(np.arange(len(faces)), side)
    image[row, column] = colors
    uv = np.column_stack([(column + 0.5) / side, 1 - (row + 0.5) / side])
    corners = np.arange(3 * len(faces)).reshape(-1, 3)
    return Painted(vertices[faces.reshape(-1)], corners, np.repeat(uv, 3, axis=0), image)


def _untiled(part: Painted) -> Painted:
    """Coordinates in [0, 1], where a repeating image is laid out as often as it is used."""
    low = np.floor(part.uv.min(axis=0) + 1e-6)
    times = np.clip(np.ceil(part.uv.max(axis=0) - low - 1e-6), 1, 8).astype(int)
    image = np.tile(part.image, (times[1], times[0], 1))
    return Painted(part.vertices, part.faces, (part.uv - low) / times, image)


def _shrunk(image: UInt8[np.ndarray, "_ _ 3"], largest: int) -> UInt8[np.ndarray, "_ _ 3"]:
    """At most so many pixels a side, at least 4 (a slot needs an inside)."""
    rows, columns = image.shape[:2]
    scale = min(1.0, largest / max(rows, columns))
    size = (max(4, round(columns * scale)), max(4, round(rows * scale)))
    if size == (columns, rows):
        return image
    return cv2.resize(image, size, interpolation=cv2.INTER_AREA).reshape(size[1], size[0], 3)
