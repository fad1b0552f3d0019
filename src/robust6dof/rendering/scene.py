"""What a renderer is given, and what it gives back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float, Float32, Int32, UInt8

from robust6dof.shapes.mesh import TexturedMesh


@dataclass(frozen=True, eq=False)
class MeshInstance:
    """A mesh placed in the world."""

    mesh: TexturedMesh
    T_world_mesh: Float[np.ndarray, "4 4"]
    instance_id: int
    """1 or more; written into the id image (0 is background)."""


@dataclass(frozen=True, eq=False)
class Light:
    """A directional light."""

    direction_world: Float[np.ndarray, "3"]
    """Unit vector from the light towards the scene."""
    color: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """Linear intensity per channel."""


@dataclass(frozen=True, eq=False)
class Scene:
    """Everything in view."""

    instances: Sequence[MeshInstance]
    lights: Sequence[Light] = ()
    ambient: tuple[float, float, float] = (0.4, 0.4, 0.4)
    background: tuple[int, int, int] = field(default=(128, 128, 128))
    """Colour where no mesh is."""


@dataclass(frozen=True, eq=False)
class Camera:
    """A pinhole camera in the world."""

    K: Float[np.ndarray, "3 3"]
    width: int
    height: int
    T_world_cam: Float[np.ndarray, "4 4"]


@dataclass(frozen=True, eq=False)
class Rendering:
    """An exact, noise-free image."""

    rgb: UInt8[np.ndarray, "H W 3"]
    depth: Float32[np.ndarray, "H W"]
    """Distance along the optical axis [m]; 0 where there is nothing."""
    ids: Int32[np.ndarray, "H W"]
    """`instance_id` of what is seen; 0 background."""
