"""Interaction matrices: how errors seen by the camera move when the camera moves.

The camera's velocity is V_C = (linear v, angular ω), both in the camera frame (OpenCV axes).
An object point at (X, Y, Z) in a camera that looks at a static world moves with −v − ω × (X, Y, Z).
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from robust6dof.geometry.transforms import skew


def extended_image_point(t_cam_obj: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
    """m_e = (X/Z, Y/Z, log Z) of a point [m] in front of the camera."""
    X, Y, Z = t_cam_obj
    return np.array([X / Z, Y / Z, np.log(Z)])


def translation_interaction(t_cam_obj: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """L_Z: ṁ_e per camera's linear velocity. Its negative is ∂m_e/∂(X, Y, Z)."""
    X, Y, Z = t_cam_obj
    return np.array([[-1.0, 0.0, X / Z], [0.0, -1.0, Y / Z], [0.0, 0.0, -1.0]]) / Z


def turning_interaction(x: float, y: float) -> Float[np.ndarray, "3 3"]:
    """L(x, y): ṁ_e per camera's angular velocity, at normalised image coordinates."""
    return np.array(
        [[x * y, -(1.0 + x * x), y], [1.0 + y * y, -x * y, -x], [-y, x, 0.0]],
    )


def point_interaction(t_cam_obj: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 6"]:
    """L = [L_Z, L(x, y)]: ṁ_e = L V_C for a static object."""
    x, y, _ = extended_image_point(t_cam_obj)
    return np.hstack([translation_interaction(t_cam_obj), turning_interaction(x, y)])


def rotation_vector_interaction(theta_u: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """L_ω of θu of c*R_c: d(θu)/dt = L_ω ω, I + θ/2 [u]× + (1 − sinc θ / sinc²(θ/2)) [u]ײ.

    The paper prints −θ/2, which is minus the matrix of cR_c*, without that minus.
    """
    return _rotation_vector_matrix(theta_u, 0.5)


def printed_rotation_vector_interaction(
    theta_u: Float[np.ndarray, "3"],
) -> Float[np.ndarray, "3 3"]:
    """L(u, θ) letter by letter, with −θ/2."""
    return _rotation_vector_matrix(theta_u, -0.5)


def _rotation_vector_matrix(
    theta_u: Float[np.ndarray, "3"], half: float
) -> Float[np.ndarray, "3 3"]:
    theta = float(np.linalg.norm(theta_u))
    if theta < 1e-9:
        return np.eye(3) + half * skew(theta_u)
    u = skew(theta_u / theta)
    # numpy's sinc(x) is sin(πx)/(πx).
    ratio = np.sinc(theta / np.pi) / np.sinc(theta / (2 * np.pi)) ** 2
    return np.eye(3) + half * theta * u + (1.0 - ratio) * (u @ u)


def rotation_error_vector(
    R_cam_obj: Float[np.ndarray, "3 3"],
    R_cam_obj_goal: Float[np.ndarray, "3 3"],
    *,
    symmetric: bool = False,
) -> Float[np.ndarray, "3"]:
    """θu of c*R_c = R* Rᵀ, in the camera frame [rad]; ω = −λ θu turns the camera to its goal.

    For a symmetric object the turn about its y axis that makes θ least is taken; θ is then the
    angle between the axis and where it should be.
    """
    if symmetric:
        R_cam_obj = R_cam_obj @ nearest_symmetric_turn(R_cam_obj, R_cam_obj_goal)
    return Rotation.from_matrix(R_cam_obj_goal @ R_cam_obj.T).as_rotvec()


def printed_rotation_error_vector(
    R_cam_obj: Float[np.ndarray, "3 3"], R_cam_obj_goal: Float[np.ndarray, "3 3"]
) -> Float[np.ndarray, "3"]:
    """θu of the paper's ΔR = R(t)ᵀ R*: the same angle, about the axis in the object's frame."""
    return Rotation.from_matrix(R_cam_obj.T @ R_cam_obj_goal).as_rotvec()


def nearest_symmetric_turn(
    R_cam_obj: Float[np.ndarray, "3 3"], R_cam_obj_goal: Float[np.ndarray, "3 3"]
) -> Float[np.ndarray, "3 3"]:
    """Turn Y about the object's y that brings R_cam_obj · Y nearest to R_cam_obj_goal.

    It maximises tr(R*ᵀ R Y) over the angle, in closed form.
    """
    M = R_cam_obj.T @ R_cam_obj_goal
    angle = np.arctan2(M[0, 2] - M[2, 0], M[0, 0] + M[2, 2])
    return Rotation.from_rotvec([0.0, angle, 0.0]).as_matrix()
