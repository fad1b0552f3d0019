"""One transform from several constraints: the last frame, stored views and the canonical anchor.

Every constraint is a set of pairs (point in the object frame, point in the current camera). A past
view's keypoints come into the object frame through that view's own T_cam_obj; the anchor's are its
canonical coordinates times the scale. The yaw of a symmetric object's anchor is a gauge: a block
with `free_yaw` turns about y with the object and leaves its yaw alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float

from robust6dof.errors import InputError
from robust6dof.geometry.transforms import skew


@dataclass(frozen=True, eq=False)
class PairBlock:
    """One constraint."""

    points_obj: Float[np.ndarray, "P 3"]
    """Points in the object frame [m]."""
    points_cam: Float[np.ndarray, "P 3"]
    """Their partners in the current camera frame [m]."""
    weight: Float[np.ndarray, "P"]
    """Weight of each pair; what a block counts is the sum of its weights."""
    free_yaw: bool = False
    """Leave the object's turn about y to the other blocks."""


@dataclass(frozen=True, eq=False)
class JointFit:
    """The joint estimate."""

    T_cam_obj: Float[np.ndarray, "4 4"]
    """Rigid transform from the object frame to the current camera."""
    residuals: Float[np.ndarray, "F"]
    """Weighted root mean square of each block, under its robust weights [m]."""
    support: Float[np.ndarray, "F"]
    """Share of each block's weight that the robust weights kept, 0 to 1."""
    information: Float[np.ndarray, "6 6"]
    """JᵀWJ for a rotation vector and a shift in the object frame, free yaws eliminated."""


def fit_joint(
    blocks: Sequence[PairBlock],
    T_cam_obj_start: Float[np.ndarray, "4 4"],
    robust_distance: float,
    iterations: int = 8,
) -> JointFit:
    """Robust (Geman-McClure) Gauss-Newton over all blocks from a start.

    Args:
        blocks: the constraints; empty ones are allowed.
        T_cam_obj_start: where to begin, such as the last frame's RANSAC fit.
        robust_distance: the residual at which a pair's weight falls to a quarter [m].
        iterations: at most.

    Raises:
        InputError: no pair at all.
    """
    if not blocks or not sum(len(block.weight) for block in blocks):
        raise InputError("a joint fit needs at least one pair")
    R, t = T_cam_obj_start[:3, :3].copy(), T_cam_obj_start[:3, 3].copy()
    yaws = np.zeros(len(blocks))
    for _ in range(iterations):
        yaws = np.array([_best_yaw(b, R, t) if b.free_yaw else 0.0 for b in blocks])
        H, g, _, _ = _normal_equations(blocks, yaws, R, t, robust_distance)
        damping = 1e-9 * max(np.trace(H), 1e-12) * np.eye(6)
        step = np.linalg.solve(H + damping, g)
        t = t + R @ step[3:]
        R = R @ cv2.Rodrigues(step[:3])[0]  # scipy's Rotation takes longer than all the rest
        if np.linalg.norm(step[:3]) < 1e-7 and np.linalg.norm(step[3:]) < 1e-8:
            break
    H, _, residuals, support = _normal_equations(blocks, yaws, R, t, robust_distance)
    T_cam_obj = np.eye(4)
    T_cam_obj[:3, :3], T_cam_obj[:3, 3] = R, t
    return JointFit(T_cam_obj, residuals, support, H)


def _normal_equations(
    blocks: Sequence[PairBlock],
    yaws: np.ndarray,
    R: np.ndarray,
    t: np.ndarray,
    robust_distance: float,
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """JᵀWJ and JᵀWr summed over blocks, and each block's residual and support."""
    H, g = np.zeros((6, 6)), np.zeros(6)
    residuals, support = np.zeros(len(blocks)), np.zeros(len(blocks))
    for index, (block, yaw) in enumerate(zip(blocks, yaws, strict=True)):
        points = _turned(block.points_obj, yaw)
        error = (block.points_cam - t) @ R - points
        square = (error**2).sum(-1)
        w = block.weight / (1.0 + square / robust_distance**2) ** 2
        H_block, g_block = _block_equations(points, error, w)
        if block.free_yaw:
            H_block, g_block = _without_yaw(H_block, g_block)
        H, g = H + H_block, g + g_block
        total = block.weight.sum()
        if total > 0:
            residuals[index] = np.sqrt(w @ square / max(w.sum(), 1e-300))
            support[index] = w.sum() / total
    return H, g, residuals, support


def _turned(points: np.ndarray, yaw: float) -> np.ndarray:
    if yaw == 0.0:
        return points
    c, s = np.cos(yaw), np.sin(yaw)
    return points @ np.array([[c, 0.0, -s], [0.0, 1.0, 0.0], [s, 0.0, c]])


def _block_equations(
    points: np.ndarray, error: np.ndarray, w: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """JᵀWJ and JᵀWr with J = [−[p]× I]: moving the object by (ω, v) moves p by ω × p + v."""
    weighted = w[:, None] * points
    moment = skew(weighted.sum(0))
    second = weighted.T @ points
    H = np.empty((6, 6))
    H[:3, :3] = np.trace(second) * np.eye(3) - second
    H[:3, 3:], H[3:, :3], H[3:, 3:] = moment, moment.T, w.sum() * np.eye(3)
    twist = weighted.T @ error  # Σ w p × e is its skew part
    torque = [twist[1, 2] - twist[2, 1], twist[2, 0] - twist[0, 2], twist[0, 1] - twist[1, 0]]
    return H, np.concatenate([torque, w @ error])


def _without_yaw(H: np.ndarray, g: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Eliminate the block's own turn about y (Schur complement): it then says nothing of it.

    Its column in the Jacobian is that of ω_y, so the eliminated rows and columns become zero.
    """
    if H[1, 1] <= 0:
        return H, g
    column = H[:, 1] / H[1, 1]
    return H - np.outer(column, H[1]), g - column * g[1]


def _best_yaw(block: PairBlock, R: np.ndarray, t: np.ndarray) -> float:
    """Turn about y [rad] that brings the block's object points closest to what is seen."""
    seen, own, w = (block.points_cam - t) @ R, block.points_obj, block.weight
    sine = w @ (seen[:, 0] * own[:, 2] - seen[:, 2] * own[:, 0])
    cosine = w @ (seen[:, 0] * own[:, 0] + seen[:, 2] * own[:, 2])
    return float(np.arctan2(sine, cosine))
