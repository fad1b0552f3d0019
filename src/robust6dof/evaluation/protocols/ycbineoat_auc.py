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
