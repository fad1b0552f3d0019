"""The field's measures of a pose, each computed as its official code does.

A missing pose is an infinite error throughout, so that it fails every threshold.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial import KDTree

from robust6dof.geometry.transforms import axis_error, invert_transform, rotation_error

_CHUNK = 64


def rotation_err_deg(
    T_cam_obj: Float[np.ndarray, "N 4 4"],
    T_cam_obj_true: Float[np.ndarray, "N 4 4"],
    symmetric: Bool[np.ndarray, "N"],
) -> Float[np.ndarray, "N"]:
    """Geodesic angle [deg]; where `symmetric`, the angle between the y axes alone."""
    R, R_true = T_cam_obj[:, :3, :3], T_cam_obj_true[:, :3, :3]
    return np.degrees(np.where(symmetric, axis_error(R, R_true), rotation_error(R, R_true)))


def translation_err_cm(
    T_cam_obj: Float[np.ndarray, "N 4 4"], T_cam_obj_true: Float[np.ndarray, "N 4 4"]
) -> Float[np.ndarray, "N"]:
    """Distance [cm] between the origins."""
    return 100.0 * np.linalg.norm(T_cam_obj[:, :3, 3] - T_cam_obj_true[:, :3, 3], axis=-1)


def add(
    points: Float[np.ndarray, "P 3"],
    T_cam_obj: Float[np.ndarray, "N 4 4"],
    T_cam_obj_true: Float[np.ndarray, "N 4 4"],
) -> Float[np.ndarray, "N"]:
    """ADD [m]: mean distance between the same model point under both poses."""
    difference = T_cam_obj[:, :3] - T_cam_obj_true[:, :3]
    homogeneous = np.c_[points, np.ones(len(points))].T
    errors = np.empty(len(T_cam_obj))
    for start in range(0, len(errors), _CHUNK):
        part = slice(start, start + _CHUNK)
        errors[part] = np.linalg.norm(difference[part] @ homogeneous, axis=1).mean(-1)
    return errors


def add_s(
    points: Float[np.ndarray, "P 3"],
    T_cam_obj: Float[np.ndarray, "N 4 4"],
    T_cam_obj_true: Float[np.ndarray, "N 4 4"],
) -> Float[np.ndarray, "N"]:
    """ADD-S [m]: mean distance from a truly posed model point to the nearest predicted one.

    The distance is taken in the predicted object frame, where one KD-tree serves every frame.
    """
    tree = KDTree(points)
    T_obj_true = invert_transform(T_cam_obj) @ T_cam_obj_true
    homogeneous = np.c_[points, np.ones(len(points))]
    errors = np.empty(len(T_cam_obj))
    for start in range(0, len(errors), _CHUNK):
        part = slice(start, start + _CHUNK)
        points_obj = homogeneous @ np.swapaxes(T_obj_true[part, :3], -1, -2)
        errors[part] = tree.query(points_obj, workers=-1)[0].mean(-1)
    return errors


def vocap_auc(errors: Float[np.ndarray, "N"], max_error: float = 0.1) -> float:
    """Area under the accuracy-threshold curve up to `max_error` [m], 0 to 100, NaN if N is 0.

    VOCap of YCB_Video_toolbox: errors above the maximum (or infinite: missing) never count as
    found but stay in the denominator.
    """
    if len(errors) == 0:
        return float("nan")
    found = np.sort(errors[errors <= max_error])
    if len(found) == 0:
        return 0.0
    accuracy = np.arange(1, len(found) + 1) / len(errors)
    recall = np.concatenate([[0.0], found, [max_error]])
    envelope = np.maximum.accumulate(np.concatenate([[0.0], accuracy, accuracy[-1:]]))
    return float(100.0 * np.sum(np.diff(recall) * envelope[1:]) / max_error)


def average_precision(
    scores: Float[np.ndarray, "K"], matched: Bool[np.ndarray, "K M"], truths: np.ndarray
) -> Float[np.ndarray, "M"]:
    """AP, 0 to 100, under M matching rules at once (VOC's every-point form, as in NOCS).

    Args:
        scores: confidence of each of K predictions; equal scores keep their order.
        matched: whether prediction k found a truth under rule m.
        truths: [M] how many truths there are under each rule; AP is NaN where none.
    """
    order = np.argsort(-scores, kind="stable")
    hits = np.cumsum(matched[order], axis=0)
    precision = hits / np.arange(1, len(scores) + 1)[:, None]
    with np.errstate(invalid="ignore", divide="ignore"):
        recall = hits / truths
    edge = np.zeros((1, matched.shape[1]))
    precision = np.concatenate([edge, precision, edge])
    recall = np.concatenate([edge, recall, edge + 1])
    envelope = np.maximum.accumulate(precision[::-1], axis=0)[::-1]
    ap = 100.0 * np.sum(np.diff(recall, axis=0) * envelope[1:], axis=0)
    return np.where(truths > 0, ap, np.nan)
