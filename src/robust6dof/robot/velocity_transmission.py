"""The paper's velocity transmission, Eqs. 1–5: vehicle and joint velocities → camera velocity.

The generalised velocity is q̇ = (ṗ, ω, η̇) (Eq. 1): linear and angular velocity of the body frame
B expressed in B, then the joint rates. The camera's velocity V_C = (linear, angular) is expressed
in the camera frame (Eq. 2). The paper's R_α^β, "α with respect to β", is our R_β_α.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from robust6dof.geometry.transforms import invert_transform, skew

VEHICLE_COLUMNS = (0, 1, 2, 5)
"""Columns of q̇ that the vehicle can be commanded in: υ = (v_x, v_y, v_z, ω_z)."""

TILT_COLUMNS = (3, 4)
"""Columns of q̇ that the vehicle's dynamics take for themselves: ∇ = (ω_x, ω_y)."""


def generalized_transform(
    T_beta_alpha: Float[np.ndarray, "*batch 4 4"],
) -> Float[np.ndarray, "*batch 6 6"]:
    """U_α^β of Eq. 4: [[R, 0], [[r]× R, R]], R and r of frame α in frame β."""
    R, r = T_beta_alpha[..., :3, :3], T_beta_alpha[..., :3, 3]
    U = np.zeros((*R.shape[:-2], 6, 6))
    U[..., :3, :3] = U[..., 3:, 3:] = R
    U[..., 3:, :3] = skew(r) @ R
    return U


def camera_jacobian(
    T_body_cam: Float[np.ndarray, "4 4"], T_body_axes: Float[np.ndarray, "N 4 4"]
) -> Float[np.ndarray, "6 M"]:
    """J of Eq. 3: V_C = J q̇.

    Args:
        T_body_cam: the camera in the body frame.
        T_body_axes: the paper's link frames L_i in the body frame, each turning about its own z.

    Returns:
        [6, 6 + N]; Eq. 3 with its z = (0, 0, 0, 0, 0, 1)ᵀ.
    """
    z = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    U_joints = generalized_transform(invert_transform(T_body_axes) @ T_body_cam)
    joint_columns = np.swapaxes(U_joints, -1, -2) @ z
    return np.hstack([generalized_transform(T_body_cam).T, joint_columns.T])


def printed_camera_jacobian(
    T_body_cam: Float[np.ndarray, "4 4"], T_body_axes: Float[np.ndarray, "N 4 4"]
) -> Float[np.ndarray, "6 M"]:
    """Eq. 5 letter by letter: lever arm bottom left, no effect of joints on the linear velocity.

    Here to be measured against Eq. 3, not to be used: its lever-arm block belongs top right.
    """
    J = camera_jacobian(T_body_cam, T_body_axes)
    printed = J.copy()
    printed[:3, 3:6] = 0.0
    printed[3:, :3] = J[:3, 3:6]
    printed[:3, 6:] = 0.0
    return printed


def approximate_camera_jacobian(
    T_body_cam: Float[np.ndarray, "4 4"], T_body_axes: Float[np.ndarray, "N 4 4"]
) -> Float[np.ndarray, "6 M"]:
    """Eq. 5 with its lever arm mended: an approximation, joints move no camera (its 0₃ₓ₄)."""
    J = camera_jacobian(T_body_cam, T_body_axes)
    J[:3, 6:] = 0.0
    return J
