"""A tracker's own past errors, from runs of `robust6dof predict`: what training pairs replay."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import pairwise
from pathlib import Path

import numpy as np

from robust6dof.data.truth_file import open_with_truth
from robust6dof.errors import DataError
from robust6dof.evaluation.records import PoseRecord, by_annotation_or_category
from robust6dof.evaluation.run_info import RunInfo
from robust6dof.evaluation.run_records import read_run_info, records_of_run
from robust6dof.frames import TrackState
from robust6dof.training.prediction_errors import PoseError
from robust6dof.training.recorded_clips import upright

_FOLLOWING = (TrackState.TRACKING, TrackState.UNCERTAIN)
"""A lost tracker does not look where its last pose says."""
_FARTHEST = 0.5
"""A track that is farther from the object than this, in diagonals, follows something else."""


def read_errors(runs: Sequence[str | Path]) -> dict[str, list[tuple[PoseError, PoseError]]]:
    """Category → errors in each two frames in a row, of all the runs together.

    A symmetric object's turn about y is no error and is left out, as are frames in which the
    tracker was lost, recovering or on something else.

    Args:
        runs: folders that `robust6dof predict` wrote; their data, with the truth, must still be
            where it was.

    Raises:
        DataError: no run, its data are gone, or the tracker followed nothing.
    """
    errors: dict[str, list[tuple[PoseError, PoseError]]] = {}
    for run in map(Path, runs):
        found = list(_of_run(run, read_run_info(run)))
        if not found:
            raise DataError(run, "its tracker followed nothing over two frames", "Name other runs")
        for category, pair in found:
            errors.setdefault(category, []).append(pair)
    return errors


def _of_run(run: Path, info: RunInfo) -> Iterable[tuple[str, tuple[PoseError, PoseError]]]:
    dataset = info.frames.of(open_with_truth(info.data, with_masks=False))
    tracks: dict[tuple[str, str], dict[int, PoseRecord]] = {}
    for record in records_of_run(run, dataset):
        tracks.setdefault((record.sequence, record.object), {})[record.frame] = record
    for track in tracks.values():
        for frame, later in pairwise(sorted(track)):
            first, second = _error(track[frame]), _error(track[later])
            if later == frame + 1 and first is not None and second is not None:
                yield track[frame].category, (first, second)


def _error(record: PoseRecord) -> PoseError | None:
    """None where the tracker did not follow the object."""
    if record.T_cam_obj is None or record.state not in _FOLLOWING:
        return None
    known = bool(np.isfinite(record.extents_true).all())
    T_true, true_sides = upright(
        record.category,
        record.T_cam_obj_true @ record.T_obj_box,
        record.extents_true if known else record.sides,
    )
    T_est, sides = upright(record.category, record.T_cam_obj @ record.T_obj_box, record.sides)
    symmetric = by_annotation_or_category(record)
    error = PoseError.between(T_true, T_est, sides / true_sides, symmetric)
    far = np.linalg.norm(error.shift_cam) > _FARTHEST * np.linalg.norm(true_sides)
    return None if far else error
