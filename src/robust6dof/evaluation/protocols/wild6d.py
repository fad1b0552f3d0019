"""`wild6d`: Wild6D's evaluate_wild6d.py.

`nocs-map` with `aabb_fixed`, every handle visible, every score 1, the true masks as detections;
per category, then averaged over the five. Frames without a mask or past the annotations are not
in the data. One object an image.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from robust6dof.evaluation.detections import images_from_records
from robust6dof.evaluation.protocols.nocs_map import score_images
from robust6dof.evaluation.records import PoseRecord
from robust6dof.evaluation.scores import Scores


def score(records: Sequence[PoseRecord]) -> Scores:
    sure = [replace(record, confidence=1.0) for record in records]
    images = images_from_records(sure)
    return score_images(images, "wild6d", "aabb_fixed", handle_rule=False)
