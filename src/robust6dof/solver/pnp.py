"""The paper's literal solver: PnP and RANSAC, 3D of the previous frame against current pixels."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Float

from robust6dof.errors import InputError
from robust6dof.geometry.transforms import make_transform
from robust6dof.solver.rigid_ransac import RigidFit


def ransac_pnp(
    points_prev: Float[np.ndarray, "P 3"],
    pixels_cur: Float[np.ndarray, "P 2"],
    K: Float[np.ndarray, "3 3"],
    inlier_px: float = 3.0,
    hypotheses: int = 200,
    seed: int = 0,
) -> RigidFit | None:
    """T_cur_prev from camera-frame points [m] at t−1 and their pixels at t.

    Returns:
        The fit, with `residual` in pixels; None where RANSAC finds no consensus.

    Raises:
        InputError: fewer than four pairs.
    """
    if len(points_prev) < 4:
        raise InputError(f"PnP needs at least 4 pairs, got {len(points_prev)}")
    cv2.setRNGSeed(seed)
    points, pixels = (
        np.ascontiguousarray(points_prev, float),
        np.ascontiguousarray(pixels_cur, float),
    )
    found, rotation, translation, index = cv2.solvePnPRansac(
        points,
        pixels,
        K,
        None,
        iterationsCount=hypotheses,
        reprojectionError=inlier_px,
        flags=cv2.SOLVEPNP_EPNP,
    )
    if not found or index is None or len(index) < 4:
        return None
    inliers = np.zeros(len(points), bool)
    inliers[index.ravel().astype(int)] = True
    rotation, translation = cv2.solvePnPRefineLM(
        points[inliers], pixels[inliers], K, None, rotation, translation
    )
    T_cur_prev = make_transform(cv2.Rodrigues(rotation)[0], translation.ravel())
    projected = cv2.projectPoints(points[inliers], rotation, translation, K, None)[0].reshape(-1, 2)
    residual = float(np.sqrt(np.mean(np.sum((projected - pixels[inliers]) ** 2, -1))))
    return RigidFit(T_cur_prev, inliers, residual)
