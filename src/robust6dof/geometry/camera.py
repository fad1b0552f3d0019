"""The pinhole camera: OpenCV axes (x right, y down, z forward), pixels with centres at integers."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

from robust6dof.errors import InputError


def project(points_cam: np.ndarray, K: np.ndarray) -> np.ndarray:
    """Project camera-frame points [..., 3] (m) to pixels [..., 2] (x, y); z must not be zero."""
    homogeneous = points_cam @ K.T
    return homogeneous[..., :2] / homogeneous[..., 2:3]


def backproject(
    depth: Float[np.ndarray, "H W"],
    K: Float[np.ndarray, "3 3"],
    mask: Bool[np.ndarray, "H W"] | None = None,
) -> tuple[Float[np.ndarray, "P 3"], Float[np.ndarray, "P 2"]]:
    """Lift the valid depth pixels (finite and positive, inside `mask`) to camera-frame points.

    Returns:
        points_cam: [P, 3] in metres.
        pixels: [P, 2] their (x, y).
    """
    valid = np.isfinite(depth) & (depth > 0)
    if mask is not None:
        valid &= mask
    y, x = np.nonzero(valid)
    z = depth[y, x].astype(np.float64)
    points_cam = np.stack([(x - K[0, 2]) * z / K[0, 0], (y - K[1, 2]) * z / K[1, 1], z], axis=-1)
    return points_cam, np.stack([x, y], axis=-1).astype(np.float64)


def check_intrinsics(K: np.ndarray, width: int, height: int) -> Float[np.ndarray, "3 3"]:
    """Return K as a float64 copy.

    Raises:
        InputError: K is not an upper-triangular pinhole matrix, or does not fit the image size.
    """
    K = np.array(K, dtype=np.float64)
    if K.shape != (3, 3) or not np.isfinite(K).all():
        raise InputError(f"intrinsics must be a finite 3×3 matrix, got {K.tolist()}")
    if not np.allclose(K[[1, 2, 2], [0, 0, 1]], 0) or not np.isclose(K[2, 2], 1):
        raise InputError(
            "intrinsics must read fx s cx / 0 fy cy / 0 0 1 row by row; "
            f"got {K.tolist()}; a column-major K has to be transposed"
        )
    if K[0, 0] <= 0 or K[1, 1] <= 0 or not 0.5 < K[0, 0] / K[1, 1] < 2.0:
        raise InputError(f"focal lengths {K[0, 0]:.4g}, {K[1, 1]:.4g} px are not those of a camera")
    if not (0.2 * width < K[0, 2] < 0.8 * width and 0.2 * height < K[1, 2] < 0.8 * height):
        raise InputError(
            f"the principal point ({K[0, 2]:.1f}, {K[1, 2]:.1f}) px lies far from the centre of "
            f"a {width}×{height} image: these intrinsics belong to another image size"
        )
    return K
