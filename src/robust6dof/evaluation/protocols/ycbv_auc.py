"""`ycbv-auc`: YCB-Video ADD / ADD-S AUC (YCB_Video_toolbox).

2,949 keyframes of videos 0048–0059, 14,025 (frame, object) pairs. Both curves for every object:
"ADD(-S)", which mixes them by symmetry, is a different number and not printed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from robust6dof.evaluation.intervals import bootstrap_interval
from robust6dof.evaluation.metrics import add, add_s, vocap_auc
from robust6dof.evaluation.records import PoseBatch, PoseRecord
from robust6dof.evaluation.scores import Row, Scores, cumulative, mean_rows

PAIRS = 14_025
DISTANCES_CM = np.arange(101) / 10


def score(records: Sequence[PoseRecord], models: Mapping[str, np.ndarray]) -> Scores:
    """Score with the model points [P, 3] of each record's category (the object's name)."""
    scores = auc_scores("ycbv-auc", records, models)
    if len(records) == PAIRS:
        return scores
    note = f"{len(records)} (frame, object) pairs, not the {PAIRS:,} of the benchmark"
    return replace(scores, notes=(note,))


def auc_scores(
    protocol: str, records: Sequence[PoseRecord], models: Mapping[str, np.ndarray]
) -> Scores:
    """AUC pooled over all pairs (`mean`), per object, and their unweighted mean (the "Average")."""
    add_errors, add_s_errors = point_errors(records, models)
    objects = np.array([record.category for record in records])
    per_object = {
        str(name): _row(add_errors[objects == name], add_s_errors[objects == name])
        for name in np.unique(objects)
    }
    return Scores(
        protocol=protocol,
        iou=None,
        mean=_row(add_errors, add_s_errors),
        per_category=per_object,
        details={
            "mean_is": "pooled over all pairs",
            "object_mean": mean_rows(per_object),
            "pairs": len(records),
            "curve_axes": {"distance": DISTANCES_CM},
            "curves": {
                "ADD": {"distance": cumulative(100 * add_errors, DISTANCES_CM)},
                "ADD-S": {"distance": cumulative(100 * add_s_errors, DISTANCES_CM)},
            },
            "pairs_missing": sum(record.T_cam_obj is None for record in records),
            "sequences": len({record.sequence for record in records}),
            "interval95": bootstrap_interval(
                [record.sequence for record in records],
                lambda rows: _row(add_errors[rows], add_s_errors[rows]),
            ),
        },
    )


def point_errors(
    records: Sequence[PoseRecord], models: Mapping[str, np.ndarray]
) -> tuple[np.ndarray, np.ndarray]:
    """ADD and ADD-S [m] of each record; infinite where the pose is missing."""
    batch = PoseBatch(records, [False] * len(records))
    add_errors, add_s_errors = np.full((2, len(records)), np.inf)
    for name, members in batch.of_category().items():
        rows = np.flatnonzero(members & batch.found)
        T_cam_obj, T_cam_obj_true = batch.T_cam_obj[rows], batch.T_cam_obj_true[rows]
        add_errors[rows] = add(models[name], T_cam_obj, T_cam_obj_true)
        add_s_errors[rows] = add_s(models[name], T_cam_obj, T_cam_obj_true)
    return add_errors, add_s_errors


def _row(add_errors: np.ndarray, add_s_errors: np.ndarray) -> Row:
    return {"ADD_auc": vocap_auc(add_errors), "ADDS_auc": vocap_auc(add_s_errors)}
