"""`aerial`: this project's own protocol, for AerialPose-Sim and any recording with poses.

Start: the first frame's mask and a true pose with CAPTRA's "Pert." noise; from then on nothing
true, and no re-initialisation from outside. The field's other rules are not used because
`nocs_official` IoU25 alone tolerates 20 cm, and errors gated by IoU reward losing the object.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import get_args

import numpy as np

from robust6dof.evaluation.intervals import Interval, bootstrap_interval, draw_by_counts
from robust6dof.evaluation.records import (
    PoseBatch,
    PoseRecord,
    by_annotation_or_category,
    without_first_frames,
)
from robust6dof.evaluation.scores import Row, Scores, mean_rows
from robust6dof.geometry.boxes import BoxIou

MIN_VISIBILITY = 0.1
"""A frame counts when at least this share of the object is in view."""
HEADLINE_IOU: BoxIou = "obb_exact"
_REPLICATES = 1000
_MEDIANS = {"R_err_deg": "R_err_deg_median", "T_err_cm": "T_err_cm_median"}


def score(records: Sequence[PoseRecord]) -> Scores:
    """Score the counted frames; means over categories, and a 95 % interval over sequences."""
    counted = counted_records(records)
    batch = PoseBatch(counted, [by_annotation_or_category(r) for r in counted])
    values = frame_values(batch)
    categories = np.array([record.category for record in counted])
    sequences = np.array([record.sequence for record in counted])
    difficulties = np.array([record.difficulty for record in counted])
    per_category = _rows(values, categories)
    return Scores(
        protocol="aerial",
        iou=HEADLINE_IOU,
        mean=mean_rows(per_category),
        per_category=per_category,
        details={
            "frames": len(counted),
            "frames_lost": sum(record.T_cam_obj is None for record in counted),
            "sequences": len(np.unique(sequences)),
            "per_difficulty": _per_difficulty(values, categories, difficulties),
            "interval95": mean_interval(values, categories, sequences),
            **batch.curves(),
        },
    )


def counted_records(records: Sequence[PoseRecord]) -> list[PoseRecord]:
    """Frames in which 10 % of the object is visible, without each track's starting frame.

    A pose from a tracker that calls itself lost is taken out.
    """
    visible = [record for record in records if record.visibility >= MIN_VISIBILITY]
    counted = without_first_frames(visible)
    return [replace(r, T_cam_obj=None) if r.lost else r for r in counted]


def frame_values(batch: PoseBatch) -> dict[str, np.ndarray]:
    """Each metric's value in each frame: 0 or 100 for a threshold, else degrees or centimetres.

    A lost or missing pose fails every threshold and counts as 180° and 1 m.
    """
    R_err_deg, T_err_cm = batch.R_err_deg(), batch.T_err_cm()
    values = {
        "5deg5cm": 100.0 * ((R_err_deg <= 5) & (T_err_cm <= 5)),
        "10deg5cm": 100.0 * ((R_err_deg <= 10) & (T_err_cm <= 5)),
    }
    ious = {kind: batch.iou(kind) for kind in get_args(BoxIou)}
    for threshold in (25, 50, 75):
        for kind, iou in ious.items():
            values[f"IoU{threshold}_{kind}"] = 100.0 * (iou > threshold / 100)
        values[f"IoU{threshold}"] = values[f"IoU{threshold}_{HEADLINE_IOU}"]
    values["R_err_deg"] = np.where(batch.found, R_err_deg, 180.0)
    values["T_err_cm"] = np.where(batch.found, T_err_cm, 100.0)
    values["lost"] = 100.0 * ~batch.found
    return values


def _rows(values: dict[str, np.ndarray], categories: np.ndarray) -> dict[str, Row]:
    rows: dict[str, Row] = {}
    for name in np.unique(categories):
        members = categories == name
        row = {key: float(value[members].mean()) for key, value in values.items()}
        for key, median_key in _MEDIANS.items():
            row[median_key] = float(np.median(values[key][members]))
        rows[str(name)] = row
    return rows


def _per_difficulty(
    values: dict[str, np.ndarray], categories: np.ndarray, difficulties: np.ndarray
) -> dict[str, Row]:
    rows: dict[str, Row] = {}
    for name in np.unique(difficulties[difficulties != ""]):
        members = difficulties == name
        within = {key: value[members] for key, value in values.items()}
        rows[str(name)] = mean_rows(_rows(within, categories[members]))
    return rows


def mean_interval(
    values: dict[str, np.ndarray],
    categories: np.ndarray,
    sequences: np.ndarray,
    seed: int = 0,
) -> Interval:
    """95 % interval of each mean over categories.

    Sums over each sequence's frames stand for them, so a thousand draws cost little. A category
    that a draw lacks leaves that draw's mean.
    """
    names, sequence_index = np.unique(sequences, return_inverse=True)
    kinds, category_index = np.unique(categories, return_inverse=True)
    shape = (len(names), len(kinds), len(values))
    sums, frames = np.zeros(shape), np.zeros(shape)
    np.add.at(sums, (sequence_index, category_index), np.stack(list(values.values()), axis=-1))
    np.add.at(frames, (sequence_index, category_index), 1.0)

    def mean(index: np.ndarray) -> Row:
        total, count = sums[index].sum(axis=0), frames[index].sum(axis=0)
        seen = count[:, 0] > 0
        return dict(zip(values, (total[seen] / count[seen]).mean(axis=0).tolist(), strict=True))

    return bootstrap_interval(names.tolist(), mean, _REPLICATES, seed, draw_by_counts)
