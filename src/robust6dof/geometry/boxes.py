"""Oriented boxes and the three intersections over union that the field prints under one name.

A box is a rigid `T_cam_obj` (its centre and axes) and its `extents`, the side lengths [m]. A NOCS
matrix [sR | t] with extents in NOCS units is the same box as [R | t] with extents in metres.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, no_type_check

import numpy as np
from jaxtyping import Bool, Float
from numba import njit

from robust6dof.geometry.transforms import invert_transform, rotation_about_y

BoxIou = Literal["nocs_official", "aabb_fixed", "obb_exact"]

SYMMETRY_STEPS = 20
"""Turns about y tried for a symmetric object, 18° apart (NOCS utils.py)."""

_CORNER_SIGNS = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], float)


def box_corners(
    T_cam_obj: Float[np.ndarray, "*N 4 4"], extents: Float[np.ndarray, "*N 3"]
) -> Float[np.ndarray, "*N 8 3"]:
    """The eight corners of each box in the camera frame [m], z fastest."""
    corners_obj = _CORNER_SIGNS * extents[..., None, :] / 2
    return corners_obj @ np.swapaxes(T_cam_obj[..., :3, :3], -1, -2) + T_cam_obj[..., None, :3, 3]


def box_iou(
    kind: BoxIou,
    T_cam_a: Float[np.ndarray, "N 4 4"],
    extents_a: Float[np.ndarray, "N 3"],
    T_cam_b: Float[np.ndarray, "N 4 4"],
    extents_b: Float[np.ndarray, "N 3"],
    symmetric: Bool[np.ndarray, "N"] | None = None,
) -> Float[np.ndarray, "N"]:
    """IoU of N pairs of boxes; where `symmetric`, the maximum over 20 turns of a about its y."""
    iou = IOU_FUNCTIONS[kind]
    result = iou(T_cam_a, extents_a, T_cam_b, extents_b)
    turning = np.zeros(len(result), bool) if symmetric is None else symmetric
    if not turning.any():
        return result
    turned = T_cam_a[turning].copy()
    for step in range(1, SYMMETRY_STEPS):
        R_obj_turned = rotation_about_y(2 * np.pi * step / SYMMETRY_STEPS)
        turned[:, :3, :3] = T_cam_a[turning, :3, :3] @ R_obj_turned
        other = iou(turned, extents_a[turning], T_cam_b[turning], extents_b[turning])
        result[turning] = np.maximum(result[turning], other)
    return result


def _interval_iou(
    low_a: np.ndarray, high_a: np.ndarray, low_b: np.ndarray, high_b: np.ndarray
) -> np.ndarray:
    """IoU of axis-aligned boxes given as intervals along the last axis."""
    overlap = np.minimum(high_a, high_b) - np.maximum(low_a, low_b)
    intersection = np.where((overlap < 0).any(-1), 0.0, overlap.prod(-1))
    union = (high_a - low_a).prod(-1) + (high_b - low_b).prod(-1) - intersection
    return intersection / union


def iou_nocs_official(
    T_cam_a: np.ndarray, extents_a: np.ndarray, T_cam_b: np.ndarray, extents_b: np.ndarray
) -> np.ndarray:
    """The IoU behind most published numbers, with its bug (NOCS utils.py).

    The extremes are taken over x, y, z of each corner instead of over the corners of each axis:
    each "box" is eight intervals from a corner's smallest to its largest coordinate. It depends
    on the distance from the camera and tolerates about 20 cm at IoU 0.25.
    """
    a, b = box_corners(T_cam_a, extents_a), box_corners(T_cam_b, extents_b)
    return _interval_iou(a.min(-1), a.max(-1), b.min(-1), b.max(-1))


def iou_aabb_fixed(
    T_cam_a: np.ndarray, extents_a: np.ndarray, T_cam_b: np.ndarray, extents_b: np.ndarray
) -> np.ndarray:
    """IoU of the boxes, aligned with the camera's axes, that enclose the two boxes (CATRE)."""
    a, b = box_corners(T_cam_a, extents_a), box_corners(T_cam_b, extents_b)
    return _interval_iou(a.min(-2), a.max(-2), b.min(-2), b.max(-2))


def iou_obb_exact(
    T_cam_a: np.ndarray, extents_a: np.ndarray, T_cam_b: np.ndarray, extents_b: np.ndarray
) -> np.ndarray:
    """Exact IoU of the two oriented boxes."""
    intersection = intersection_volume(T_cam_a, extents_a, T_cam_b, extents_b)
    return intersection / (extents_a.prod(-1) + extents_b.prod(-1) - intersection)


IOU_FUNCTIONS: dict[str, Callable[..., np.ndarray]] = {
    "nocs_official": iou_nocs_official,
    "aabb_fixed": iou_aabb_fixed,
    "obb_exact": iou_obb_exact,
}


def intersection_volume(
    T_cam_a: np.ndarray, extents_a: np.ndarray, T_cam_b: np.ndarray, extents_b: np.ndarray
) -> np.ndarray:
    """Volume [m³] of the intersection of N pairs of oriented boxes, to about one part in 10⁸.

    By the divergence theorem: each face is clipped to the other box, and a third of its area
    times its distance from one fixed point is summed. Box b is inflated by a billionth, so
    that faces which coincide count once.
    """
    T_b_a = invert_transform(T_cam_b) @ T_cam_a
    T_a_b = invert_transform(T_b_a)
    margin = 1e-9 * np.linalg.norm(extents_b, axis=-1, keepdims=True)
    half_a, half_b = extents_a / 2, extents_b / 2 + margin
    center_b_in_a = T_a_b[:, :3, 3]
    volumes = _face_flux(T_b_a, half_a, half_b, np.zeros_like(center_b_in_a))
    volumes += _face_flux(T_a_b, half_b, half_a, center_b_in_a)
    return np.clip(volumes, 0.0, np.minimum(extents_a.prod(-1), extents_b.prod(-1)))


@njit(cache=True)
@no_type_check
def _face_flux(T, half, half_other, origin):
    """A third of Σ area · distance from `origin` over the faces of each box (T, half) inside the
    axis-aligned box |x| ≤ half_other."""
    fluxes = np.zeros(len(T))
    polygon, clipped = np.empty((12, 3)), np.empty((12, 3))
    for i in range(len(T)):
        for axis in range(3):
            normal = T[i, :3, axis]
            for sign in (-1.0, 1.0):
                _write_face(T[i], half[i], axis, sign, polygon)
                height = 0.0
                for row in range(3):
                    height += sign * normal[row] * (polygon[0, row] - origin[i, row])
                count = 4
                for k in range(3):
                    count = _clip(polygon, count, k, 1.0, half_other[i, k], clipped)
                    count = _clip(clipped, count, k, -1.0, half_other[i, k], polygon)
                fluxes[i] += _area(polygon, count, normal) * height / 3.0
    return fluxes


@njit(cache=True)
@no_type_check
def _write_face(T, half, axis, sign, polygon):
    """The four corners, in order around it, of one face of box (T, half)."""
    u, v = (axis + 1) % 3, (axis + 2) % 3
    for row in range(3):
        center = T[row, 3] + sign * half[axis] * T[row, axis]
        edge_u, edge_v = half[u] * T[row, u], half[v] * T[row, v]
        polygon[0, row] = center + edge_u + edge_v
        polygon[1, row] = center - edge_u + edge_v
        polygon[2, row] = center - edge_u - edge_v
        polygon[3, row] = center + edge_u - edge_v


@njit(cache=True)
@no_type_check
def _area(polygon, count, normal):
    """Area of a convex polygon with unit normal ±`normal`."""
    total = 0.0
    for j in range(count):
        p, q = polygon[j], polygon[(j + 1) % count]
        total += normal[0] * (p[1] * q[2] - p[2] * q[1])
        total += normal[1] * (p[2] * q[0] - p[0] * q[2])
        total += normal[2] * (p[0] * q[1] - p[1] * q[0])
    return 0.5 * abs(total)


@njit(cache=True)
@no_type_check
def _clip(polygon, count, axis, sign, limit, clipped):
    """Sutherland–Hodgman: keep the part of a convex polygon with sign · x[axis] ≤ limit."""
    kept = 0
    for j in range(count):
        p, q = polygon[j], polygon[(j + 1) % count]
        depth_p, depth_q = limit - sign * p[axis], limit - sign * q[axis]
        if depth_p >= 0.0:
            clipped[kept, 0], clipped[kept, 1], clipped[kept, 2] = p[0], p[1], p[2]
            kept += 1
        if (depth_p >= 0.0) != (depth_q >= 0.0):
            share = depth_p / (depth_p - depth_q)
            for row in range(3):
                clipped[kept, row] = p[row] + share * (q[row] - p[row])
            kept += 1
    return kept
