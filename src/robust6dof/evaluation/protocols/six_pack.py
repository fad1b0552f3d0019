"""`6pack`: NOCS-REAL275 tracking as 6-PACK's benchmark.py scores it (BundleTrack uses it too).

Per category over every (instance, scene, frame) with ground truth, the first included; start with
U(−2, 2) cm of translation noise on each axis, no re-initialisation. The mug is never symmetric.
Its known bugs are kept here and left out in `6pack-fixed`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from robust6dof.evaluation.records import PoseBatch, PoseRecord, by_category
from robust6dof.evaluation.scores import Row, Scores, average, mean_rows, percent
from robust6dof.geometry.boxes import box_iou

NOTES = (
    "R_err and T_err are means over frames with IoU above 0.25 only",
    "published figures are averages of 5 runs",
)


def score(records: Sequence[PoseRecord]) -> Scores:
    """Score with the benchmark's bug: the truth's box is scaled once more by the NOCS scale.

    (Its other two bugs, the ground truth looked up by line number and CAMERA's intrinsics on
    REAL images, are of reading data; the readers here do not have them.)
    """
    batch = PoseBatch(records, [by_category(record) for record in records])
    nocs_scale = np.linalg.norm(batch.extents_true, axis=-1, keepdims=True)
    return score_batch("6pack", batch, batch.extents_true * nocs_scale)


def score_batch(protocol: str, batch: PoseBatch, truth_extents: np.ndarray) -> Scores:
    """Score with the true instance's box around both poses."""
    R_err_deg, T_err_cm = batch.R_err_deg(), batch.T_err_cm()
    iou = _iou(batch, truth_extents)

    def rows(index: np.ndarray) -> dict[str, Row]:
        errors = (R_err_deg[index], T_err_cm[index], iou[index])
        return _rows(batch.category[index], *errors)

    per_category = rows(np.arange(len(iou)))
    return Scores(
        protocol=protocol,
        iou="nocs_official",
        mean=mean_rows(per_category),
        per_category=per_category,
        details={
            "frames": len(batch.found),
            "frames_missing": int((~batch.found).sum()),
            **batch.interval(rows),
            **batch.curves(),
        },
        notes=NOTES,
    )


def _rows(
    category: np.ndarray, R_err_deg: np.ndarray, T_err_cm: np.ndarray, iou: np.ndarray
) -> dict[str, Row]:
    """Figures of each category from the errors of its frames."""
    per_category: dict[str, Row] = {}
    for name in np.unique(category):
        members = category == name
        gate = members & (iou > 0.25)
        per_category[str(name)] = {
            "5deg5cm": percent((R_err_deg < 5)[members] & (T_err_cm < 5)[members]),
            "IoU25": percent(iou[members] > 0.25),
            "R_err_deg": average(R_err_deg[gate]),
            "T_err_cm": average(T_err_cm[gate]),
        }
    return per_category


def _iou(batch: PoseBatch, truth_extents: np.ndarray) -> np.ndarray:
    """Where symmetric, benchmark.py turns the truth's box, not the prediction's."""
    truth, prediction = (batch.T_cam_obj_true, truth_extents), (batch.T_cam_obj, batch.extents_true)
    iou = box_iou("nocs_official", *truth, *prediction, batch.symmetric)
    return np.where(batch.found, iou, 0.0)
