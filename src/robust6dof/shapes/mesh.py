"""A textured triangle mesh and the object made of it: what shapes produce and renderers draw."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int, UInt8


@dataclass(frozen=True)
class Material:
    """How the surface reflects (Blinn-Phong)."""

    specular: float = 0.1
    """Strength of the highlight, 0 (matt) to 1 (mirror-like)."""
    shininess: float = 20.0
    """Exponent of the highlight."""


@dataclass(frozen=True, eq=False)
class TexturedMesh:
    """Triangles with one texture image. Faces are counter-clockwise seen from outside."""

    vertices: Float[np.ndarray, "V 3"]
    """Positions [m]."""
    faces: Int[np.ndarray, "F 3"]
    """Vertex indices of each triangle."""
    uv: Float[np.ndarray, "V 2"]
    """Texture coordinates: u to the right, v upwards from the image's bottom row; they repeat."""
    texture: UInt8[np.ndarray, "Th Tw 3"]
    """RGB image, first row at the top; a plain colour is a 1×1 image."""
    material: Material = field(default_factory=Material)


@dataclass(frozen=True, eq=False)
class ObjectModel:
    """One object: a metric mesh in the canonical axes, centred on its bounding box.

    Canonical axes as in NOCS: y up, mug handle and camera lens towards +x, laptop lid at −x.
    """

    mesh: TexturedMesh
    category: str
    name: str
    parameters: dict[str, float | str] = field(default_factory=dict)
    """What a procedural shape was drawn from."""

    @cached_property
    def extents(self) -> Float[np.ndarray, "3"]:
        """Side lengths of the bounding box [m]."""
        return np.ptp(self.mesh.vertices, axis=0)

    @property
    def scale(self) -> float:
        """Diagonal of the box [m]; vertices divided by it are NOCS coordinates about 0."""
        return float(np.linalg.norm(self.extents))
