"""What is predicted and what is true in one image, without knowing which belongs to which."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from robust6dof.evaluation.records import PoseRecord


@dataclass(frozen=True, eq=False)
class Boxes:
    """Posed boxes of one image."""

    category: list[str]
    T_cam_obj: Float[np.ndarray, "N 4 4"]
    """Rigid: a NOCS matrix [sR | t] with its scale divided out."""
    extents: Float[np.ndarray, "N 3"]
    """Side lengths [m]."""
    score: Float[np.ndarray, "N"]
    """Confidence of a prediction; 1 for a truth."""
    handle_visible: Bool[np.ndarray, "N"]
    """Of a truth; True for a prediction."""


@dataclass(frozen=True, eq=False)
class Image:
    """One image of a detection benchmark."""

    name: str
    predicted: Boxes
    true: Boxes
    sequence: str = ""
    """The video that it is from; images of one are not independent."""


def images_from_records(records: Sequence[PoseRecord]) -> list[Image]:
    """Gather records by sequence and frame; the score is the tracker's confidence."""
    groups: dict[tuple[str, int], list[PoseRecord]] = {}
    for record in records:
        groups.setdefault((record.sequence, record.frame), []).append(record)
    return [
        Image(f"{sequence}/{frame}", _predicted(group), _true(group), sequence)
        for (sequence, frame), group in groups.items()
    ]


def _true(group: Sequence[PoseRecord]) -> Boxes:
    return Boxes(
        [record.category for record in group],
        np.array([record.T_cam_obj_true for record in group], float).reshape(-1, 4, 4),
        np.array([record.extents_true for record in group], float).reshape(-1, 3),
        np.ones(len(group)),
        np.array([record.handle_visible for record in group], bool),
    )


def _predicted(group: Sequence[PoseRecord]) -> Boxes:
    found = [record for record in group if record.T_cam_obj is not None]
    return Boxes(
        [record.category for record in found],
        np.array([record.T_cam_obj for record in found], float).reshape(-1, 4, 4),
        np.array([record.sides for record in found], float).reshape(-1, 3),
        np.array([record.confidence for record in found], float),
        np.ones(len(found), bool),
    )
