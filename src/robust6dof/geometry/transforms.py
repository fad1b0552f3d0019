"""Rigid transforms as plain 4×4 arrays.

`T_dst_src` maps coordinates in `src` to coordinates in `dst`; neighbouring names match:
`T_world_obj = T_world_cam @ T_cam_obj`. Lengths in metres, angles in radians.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from robust6dof.errors import InputError


def make_transform(R_dst_src: np.ndarray, t_dst_src: np.ndarray) -> Float[np.ndarray, "4 4"]:
    """Put a 3×3 rotation and a translation [m] into one 4×4 transform."""
    T_dst_src = np.eye(4)
    T_dst_src[:3, :3] = R_dst_src
    T_dst_src[:3, 3] = t_dst_src
    return T_dst_src


def invert_transform(T_dst_src: np.ndarray) -> np.ndarray:
    """Invert rigid transforms [..., 4, 4] without a general matrix inverse."""
    R_src_dst = np.swapaxes(T_dst_src[..., :3, :3], -1, -2)
    T_src_dst = np.zeros_like(T_dst_src)
    T_src_dst[..., :3, :3] = R_src_dst
    T_src_dst[..., :3, 3] = -np.einsum("...ij,...j->...i", R_src_dst, T_dst_src[..., :3, 3])
    T_src_dst[..., 3, 3] = 1.0
    return T_src_dst


def transform_points(T_dst_src: np.ndarray, points_src: np.ndarray) -> np.ndarray:
    """Map points [..., 3] from `src` to `dst`."""
    return points_src @ T_dst_src[:3, :3].T + T_dst_src[:3, 3]


def rotation_angle(R: np.ndarray) -> np.ndarray:
    """Angle [rad] of rotations [..., 3, 3], in [0, π]; 0-d for a single one.

    Uses ‖R − I‖_F = 2√2 sin(θ/2) below a right angle, which stays exact near the identity
    (arccos of the trace does not), and the trace beyond, where it is the exact one.
    """
    sin_half = np.linalg.norm(R - np.eye(3), axis=(-2, -1)) / (2.0 * np.sqrt(2.0))
    cos_half_sq = (np.trace(R, axis1=-2, axis2=-1) + 1.0) / 4.0
    cos_half = np.sqrt(np.clip(cos_half_sq, 0.0, None))
    return np.asarray(2.0 * np.arctan2(sin_half, cos_half))


def rotation_error(R_a: np.ndarray, R_b: np.ndarray) -> np.ndarray:
    """Geodesic angle [rad] between rotations [..., 3, 3]."""
    return rotation_angle(R_a @ np.swapaxes(R_b, -1, -2))


def axis_error(R_a: np.ndarray, R_b: np.ndarray, axis: int = 1) -> np.ndarray:
    """Angle [rad] between one body axis of two rotations: the symmetric objects' error (y)."""
    a, b = R_a[..., :, axis], R_b[..., :, axis]
    cross = np.linalg.norm(np.cross(a, b), axis=-1)
    return np.asarray(np.arctan2(cross, np.sum(a * b, axis=-1)))


def orientation_error(R_a: np.ndarray, R_b: np.ndarray, symmetric: bool) -> float:
    """Angle [rad] between two orientations; the y axes' alone for a symmetric object."""
    return float(axis_error(R_a, R_b) if symmetric else rotation_error(R_a, R_b))


def view_direction(T_cam_obj: np.ndarray) -> Float[np.ndarray, "3"]:
    """Unit vector from the object to the camera, in the object frame; zero where they meet."""
    camera_obj = invert_transform(T_cam_obj)[:3, 3]
    return camera_obj / max(float(np.linalg.norm(camera_obj)), 1e-9)


def rotation_about_y(angle: float) -> Float[np.ndarray, "3 3"]:
    """Rotation by `angle` [rad] about y, the symmetry axis of the canonical frame."""
    return Rotation.from_rotvec([0.0, angle, 0.0]).as_matrix()


def skew(v: np.ndarray) -> np.ndarray:
    """Cross-product matrices [..., 3, 3] of vectors [..., 3]: skew(v) @ w = v × w."""
    zero = np.zeros_like(v[..., 0])
    rows = [
        [zero, -v[..., 2], v[..., 1]],
        [v[..., 2], zero, -v[..., 0]],
        [-v[..., 1], v[..., 0], zero],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def check_transform(T_dst_src: np.ndarray, name: str = "transform") -> Float[np.ndarray, "4 4"]:
    """Return a clean float64 copy of a rigid transform.

    Raises:
        InputError: not 4×4, not finite, a rotation block that is scaled, mirrored or sheared,
            or a last row other than 0 0 0 1.
    """
    T = np.array(T_dst_src, dtype=np.float64)
    if T.shape != (4, 4):
        raise InputError(f"{name} must be a 4×4 matrix, got shape {T.shape}")
    if not np.isfinite(T).all():
        raise InputError(f"{name} contains NaN or infinity")
    if not np.allclose(T[3], [0, 0, 0, 1], atol=1e-6):
        raise InputError(f"{name}: the last row must be 0 0 0 1, got {T[3].tolist()}")
    T[:3, :3] = check_rotation(T[:3, :3], f"{name}: the 3×3 block")
    T[3] = [0, 0, 0, 1]
    return T


def check_rotation(R_dst_src: np.ndarray, name: str = "rotation") -> Float[np.ndarray, "3 3"]:
    """Return a clean float64 copy of a rotation matrix.

    Raises:
        InputError: not 3×3, not finite, scaled, mirrored or sheared.
    """
    R = np.array(R_dst_src, dtype=np.float64)
    if R.shape != (3, 3):
        raise InputError(f"{name} must be a 3×3 matrix, got shape {R.shape}")
    if not np.isfinite(R).all():
        raise InputError(f"{name} contains NaN or infinity")
    determinant = np.linalg.det(R)
    if not np.allclose(R @ R.T, np.eye(3), atol=1e-3) or determinant < 0:
        raise InputError(
            f"{name} is not a rotation (determinant {determinant:.4g}); "
            "divide a scaled matrix, such as NOCS' own, by its scale first"
        )
    U, _, Vt = np.linalg.svd(R)
    return U @ Vt
