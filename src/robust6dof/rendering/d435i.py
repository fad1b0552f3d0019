"""The pinhole of an Intel RealSense D435i: its colour camera, depth registered to it."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from robust6dof.rendering.scene import Camera

WIDTH, HEIGHT = 640, 480
"""Of the colour stream [px]."""

FOCAL_PX = 615.0
"""Of the colour stream at 640×480: a horizontal field of view of 55°."""


def color_camera(T_world_cam: Float[np.ndarray, "4 4"], scale: float = 1.0) -> Camera:
    """The colour camera, its image scaled by `scale`."""
    width, height = round(WIDTH * scale), round(HEIGHT * scale)
    focal = FOCAL_PX * scale
    K = np.array(
        [[focal, 0.0, (width - 1) / 2.0], [0.0, focal, (height - 1) / 2.0], [0.0, 0.0, 1.0]]
    )
    return Camera(K, width, height, T_world_cam)
