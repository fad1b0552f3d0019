"""`ycbineoat-auc`: YCBInEOAT (eval_ycbineoat.py of se(3)-TrackNet and BundleTrack).

9 videos, 5 objects, 7,449 frames, every frame scored, ground truth on the first frame, no
re-initialisation. AUC as in `ycbv-auc`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from robust6dof.evaluation.protocols.ycbv_auc import auc_scores
from robust6dof.evaluation.records import PoseRecord
from robust6dof.evaluation.scores import Scores
from robust6dof.geometry.transforms import invert_transform

FRAMES = 7_449
VIDEO_OBJECTS = {
    "bleach0": "021_bleach_cleanser",
    "bleach_hard_00_03_chaitanya": "021_bleach_cleanser",
    "cracker_box_reorient": "003_cracker_box",
    "cracker_box_yalehand0": "003_cracker_box",
    "mustard0": "006_mustard_bottle",
    "mustard_easy_00_02": "006_mustard_bottle",
    "sugar_box1": "004_sugar_box",
    "sugar_box_yalehand0": "004_sugar_box",
    "tomato_soup_can_yalehand0": "005_tomato_soup_can",
}
"""Which object each video shows: its folder's name is all that says so."""


def score(records: Sequence[PoseRecord], models: Mapping[str, np.ndarray]) -> Scores:
    scores = auc_scores("ycbineoat-auc", records, models)
    if len(records) == FRAMES:
        return scores
    note = f"{len(records)} frames, not the {FRAMES:,} of the benchmark"
    return replace(scores, notes=(note,))


def align_first_frame(records: Sequence[PoseRecord]) -> list[PoseRecord]:
    """Right-multiply each track so that its first pose is the truth: a model-free tracker's due."""
    aligned: list[PoseRecord] = []
    T_given_obj: dict[tuple[str, str], np.ndarray] = {}
    for record in sorted(records, key=lambda r: (r.sequence, r.object, r.frame)):
        key = (record.sequence, record.object)
        if record.T_cam_obj is None:
            aligned.append(record)
            continue
        if key not in T_given_obj:
            T_given_obj[key] = invert_transform(record.T_cam_obj) @ record.T_cam_obj_true
        aligned.append(replace(record, T_cam_obj=record.T_cam_obj @ T_given_obj[key]))
    return aligned
