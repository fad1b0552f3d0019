"""One line of truth and prediction per frame and object: what every protocol scores."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from robust6dof.data.dataset import ObjectTruth
from robust6dof.data.truth_file import AnnotatedTruth
from robust6dof.evaluation.intervals import bootstrap_interval
from robust6dof.evaluation.metrics import rotation_err_deg, translation_err_cm
from robust6dof.evaluation.scores import Row, cumulative, mean_rows
from robust6dof.frames import SYMMETRIC_CATEGORIES, TrackState
from robust6dof.geometry.boxes import BoxIou, box_iou
from robust6dof.geometry.transforms import make_transform

HANDLED_CATEGORIES = frozenset({"mug", "025_mug"})
"""Symmetric while their handle hides; only NOCS' own protocols know of no other than mug."""


@dataclass(frozen=True, eq=False, kw_only=True)
class PoseRecord:
    """The truth about one object in one frame, and the pose that a tracker gave for it."""

    sequence: str
    frame: int
    """Index in its sequence."""
    object: str
    category: str
    T_cam_obj_true: Float[np.ndarray, "4 4"]
    extents_true: Float[np.ndarray, "3"]
    """Side lengths of the true box [m]; NaN where the data set has none."""
    box_center: Float[np.ndarray, "3"] = field(default_factory=lambda: np.zeros(3))
    """Centre of the box in the object frame [m]; zero but for YCB models."""
    T_cam_obj: Float[np.ndarray, "4 4"] | None = None
    """The predicted pose; None where it is missing."""
    extents: Float[np.ndarray, "3"] | None = None
    """Predicted side lengths [m]."""
    confidence: float = 1.0
    state: TrackState = TrackState.TRACKING
    """What the tracker said of itself."""
    stamp: float | None = None
    """Of the frame [s]; None where the recording has none."""
    visibility: float = 1.0
    """Share of the object's silhouette that is in view, 0 to 1."""
    symmetric: bool = False
    """Turning the object about its y axis changes nothing."""
    handle_visible: bool = True
    difficulty: str = ""
    frame_name: str = ""
    """The recording's own name of the frame."""

    @property
    def lost(self) -> bool:
        """The tracker called itself lost: what it gave is no claim."""
        return self.state is TrackState.LOST

    @property
    def sides(self) -> Float[np.ndarray, "3"]:
        """Predicted side lengths [m]; the true ones where none were predicted."""
        return self.extents_true if self.extents is None else self.extents

    @property
    def T_obj_box(self) -> Float[np.ndarray, "4 4"]:
        """The box in the object frame."""
        return make_transform(np.eye(3), self.box_center)


def by_category(seen: PoseRecord | ObjectTruth) -> bool:
    """The usual rule of symmetry: bottle, bowl, can; never a mug."""
    return seen.category in SYMMETRIC_CATEGORIES


def by_annotation_or_category(seen: PoseRecord | ObjectTruth) -> bool:
    """What the data call symmetric; bottle, bowl, can; a mug whose handle this frame hides."""
    annotated = isinstance(seen, (PoseRecord, AnnotatedTruth)) and seen.symmetric
    hidden_handle = seen.category in HANDLED_CATEGORIES and not seen.handle_visible
    return annotated or by_category(seen) or hidden_handle


def without_first_frames(records: Sequence[PoseRecord]) -> list[PoseRecord]:
    """The records but for each track's first, in which the tracker was told."""
    first: dict[tuple[str, str], int] = {}
    for record in records:
        key = (record.sequence, record.object)
        first[key] = min(record.frame, first.get(key, record.frame))
    return [r for r in records if r.frame > first[r.sequence, r.object]]


class PoseBatch:
    """Records as arrays. Errors of missing poses are infinite, their IoU is zero."""

    def __init__(self, records: Sequence[PoseRecord], symmetric: Sequence[bool]) -> None:
        self.symmetric = np.asarray(symmetric, bool).reshape(len(records))
        self.category = np.array([record.category for record in records])
        self.sequence = np.array([record.sequence for record in records])
        self.found = np.array([record.T_cam_obj is not None for record in records], bool)
        poses = [np.eye(4) if r.T_cam_obj is None else r.T_cam_obj for r in records]
        self.T_cam_obj = np.array(poses, float).reshape(-1, 4, 4)
        self.extents = np.array([r.sides for r in records], float).reshape(-1, 3)
        truths = [record.T_cam_obj_true for record in records]
        self.T_cam_obj_true = np.array(truths, float).reshape(-1, 4, 4)
        self.extents_true = np.array([r.extents_true for r in records], float).reshape(-1, 3)
        self.T_obj_box = np.array([r.T_obj_box for r in records], float).reshape(-1, 4, 4)

    def R_err_deg(self) -> Float[np.ndarray, "N"]:
        errors = rotation_err_deg(self.T_cam_obj, self.T_cam_obj_true, self.symmetric)
        return np.where(self.found, errors, np.inf)

    def T_err_cm(self) -> Float[np.ndarray, "N"]:
        return np.where(self.found, translation_err_cm(self.T_cam_obj, self.T_cam_obj_true), np.inf)

    def iou(self, kind: BoxIou) -> Float[np.ndarray, "N"]:
        """IoU of the predicted with the true box; the prediction turns where symmetric."""
        iou = box_iou(
            kind,
            self.T_cam_obj @ self.T_obj_box,
            self.extents,
            self.T_cam_obj_true @ self.T_obj_box,
            self.extents_true,
            self.symmetric,
        )
        return np.where(self.found, iou, 0.0)

    def curves(self) -> dict[str, Any]:
        """Share of frames within each rotation [deg] and translation error [cm], by category."""
        R_err_deg, T_err_cm = self.R_err_deg(), self.T_err_cm()
        axes = {"rotation": np.arange(61.0), "translation": np.arange(41) / 2}
        return {
            "curve_axes": axes,
            "curves": {
                name: {
                    "rotation": cumulative(R_err_deg[members], axes["rotation"]),
                    "translation": cumulative(T_err_cm[members], axes["translation"]),
                }
                for name, members in self.of_category().items()
            },
        }

    def of_category(self) -> dict[str, Bool[np.ndarray, "N"]]:
        """Which rows belong to each category present, in alphabetical order."""
        return {str(name): self.category == name for name in np.unique(self.category)}

    def interval(self, rows: Callable[[np.ndarray], dict[str, Row]]) -> dict[str, Any]:
        """Number of sequences, and 95 % interval of the mean over categories.

        Args:
            rows: figures of each category over the records of these indices.
        """
        interval = bootstrap_interval(self.sequence.tolist(), lambda index: mean_rows(rows(index)))
        return {"sequences": len(np.unique(self.sequence)), "interval95": interval}
