"""`captra`: NOCS-REAL275 tracking as CAPTRA scores it (misc/eval/eval.py).

Start with "Pert." noise; frame 0 excluded; no gate and no clipping; 5°5cm with ≤; the y-axis
angle for bottle, bowl and can, geodesic for camera, laptop and mug. What its tables call IoU is
the mean IoU, with the predicted size and `aabb_fixed`. The ground truth of NOCS is fitted anew to
`*_coord.png` and depth: `evaluation/captra_truth.py`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from robust6dof.evaluation.records import PoseBatch, PoseRecord, by_category, without_first_frames
from robust6dof.evaluation.scores import Row, Scores, average, mean_rows, percent


def score(records: Sequence[PoseRecord]) -> Scores:
    """Mean over all frames but each track's first; errors are undefined where a pose is missing."""
    kept = without_first_frames(records)
    batch = PoseBatch(kept, [by_category(record) for record in kept])
    R_err_deg, T_err_cm, iou = batch.R_err_deg(), batch.T_err_cm(), batch.iou("aabb_fixed")

    def rows(index: np.ndarray) -> dict[str, Row]:
        errors = (R_err_deg[index], T_err_cm[index], iou[index])
        return _rows(batch.category[index], *errors)

    per_category = rows(np.arange(len(kept)))
    missing = int((~batch.found).sum())
    return Scores(
        protocol="captra",
        iou="aabb_fixed",
        mean=mean_rows(per_category),
        per_category=per_category,
        details={
            "frames": len(kept),
            "frames_missing": missing,
            **batch.interval(rows),
            **batch.curves(),
        },
        notes=(f"{missing} poses are missing, so their mean errors are undefined",) * bool(missing),
    )


def _rows(
    category: np.ndarray, R_err_deg: np.ndarray, T_err_cm: np.ndarray, iou: np.ndarray
) -> dict[str, Row]:
    """Figures of each category from the errors of its frames."""
    per_category: dict[str, Row] = {}
    for name in np.unique(category):
        members = category == name
        per_category[str(name)] = {
            "5deg5cm": percent((R_err_deg <= 5)[members] & (T_err_cm <= 5)[members]),
            "mean_IoU": 100.0 * average(iou[members]),
            "IoU25": percent(iou[members] > 0.25),
            "R_err_deg": average(R_err_deg[members]),
            "T_err_cm": average(T_err_cm[members]),
        }
    return per_category
