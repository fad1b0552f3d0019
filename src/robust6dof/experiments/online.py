"""Beyond the paper: losses and recoveries, whether the confidence is honest, and drift."""

from __future__ import annotations

from functools import reduce
from itertools import groupby
from operator import add

import numpy as np

from robust6dof.evaluation.calibration import Reliability, reliability
from robust6dof.evaluation.data_kind import data_kind
from robust6dof.evaluation.intervals import bootstrap_interval
from robust6dof.evaluation.losses import FollowedFrames, LossCounts, count_losses
from robust6dof.evaluation.records import PoseRecord
from robust6dof.evaluation.scores import Row
from robust6dof.experiments.figures import Series, plot_curves, plot_reliability
from robust6dof.experiments.report import Line, Report
from robust6dof.experiments.setting import Setting

_LOSS_COLUMNS = (
    "losses",
    "noticed_in_5",
    "returns",
    "found_in_1s",
    "slips",
    "mended_in_1s",
    "wrong_locks_per_loss",
    "good_frames",
    "silent",
    "alarms_per_1000",
)
_LOSS_NOTE = (
    "a loss: over 20° or 10 cm for 3 frames, or under 5 % visible; noticed: no longer TRACKING "
    "within 5 frames, of those that last longer; a return: half visible again for half a second; "
    "found: within 20° and 10 cm, not LOST, within 1 s of it; a slip: a loss in full view, mended "
    "as a return is found; a wrong lock: TRACKING for 3 frames of a loss; a good frame: within 10° "
    "and 5 cm, half visible; silent: good frames that are not called TRACKING [%]; an alarm: a run "
    "of those that neither leads into a loss nor falls into the second after one"
)
_DRIFT_PARTS = 20


def losses(setting: Setting) -> Report:
    """How each tracker loses its object, notices it, and finds it again."""
    lines = []
    for tracker in (setting.trackers[0], "no-recovery", *setting.trackers[1:]):
        tracks = _tracks(setting, tracker)
        counts = [count_losses(FollowedFrames.of(records)) for records in tracks]

        def row(index: np.ndarray, counts: list[LossCounts] = counts) -> Row:
            return reduce(add, [counts[i] for i in index], LossCounts()).row()

        sequences = [records[0].sequence for records in tracks]
        interval = bootstrap_interval(sequences, row)
        lines.append(Line(tracker, row(np.arange(len(counts))), interval))
    return Report(
        "Losses and recoveries",
        data_kind(setting.dataset_path()),
        _LOSS_COLUMNS,
        tuple(lines),
        (),
        (_LOSS_NOTE,),
        "aerial",
    )


def calibration(setting: Setting) -> Report:
    """The confidence against the share of poses within 10° and 5 cm."""
    found: dict[str, Reliability] = {}
    lines = []
    for tracker in setting.trackers:
        tracks = _tracks(setting, tracker)
        followed = [FollowedFrames.of(records) for records in tracks]
        right = np.concatenate([frames.right for frames in followed])
        claimed = ~np.concatenate([frames.called_lost for frames in followed])
        confidence = np.array([one.confidence for records in tracks for one in records[1:]])
        found[tracker] = reliability(confidence[claimed], right[claimed])
        values = {
            "frames": float(len(right)),
            "claimed": float(claimed.sum()),
            "right": 100.0 * float(right[claimed].mean()),
            "mean_confidence": 100.0 * float(confidence[claimed].mean()),
            "ECE": 100.0 * found[tracker].expected_error,
            "ECE_with_lost": 100.0 * reliability(confidence, right).expected_error,
        }
        lines.append(Line(tracker, values))
    figure = plot_reliability(setting.out / "reliability.png", found)
    return Report(
        "Is the confidence the share of poses within 10° and 5 cm?",
        data_kind(setting.dataset_path()),
        ("frames", "claimed", "right", "mean_confidence", "ECE", "ECE_with_lost"),
        tuple(lines),
        (figure,),
        (
            "claimed: frames that are not called LOST; right, mean confidence: of these; ECE: "
            "expected calibration error in points, 15 bins of equal count, of these, and with the "
            "lost ones, whose confidence is 0 though the place may still be right",
        ),
        "aerial",
    )


def drift(setting: Setting) -> Report:
    """Errors over the longest recording, in parts: joined views against chained changes."""
    lines, places = [], np.zeros(0)
    turns: dict[str, Series] = {}
    gaps: dict[str, Series] = {}
    for tracker in (setting.trackers[0], "chained", *setting.trackers[1:]):
        frames = FollowedFrames.of(max(_tracks(setting, tracker), key=len))
        parts = np.array_split(np.arange(len(frames.stamps)), _DRIFT_PARTS)
        places = np.array([part.mean() for part in parts])
        turns[tracker] = Series([float(np.median(frames.R_err_deg[part])) for part in parts])
        gaps[tracker] = Series([float(np.median(frames.T_err_cm[part])) for part in parts])
        lines.append(Line(tracker, _ends(frames, turns[tracker], gaps[tracker])))
    axis = ("frame", "rotation error [°]"), ("frame", "distance [cm]")
    figures = (
        plot_curves(
            setting.out / "drift-rotation.png", list(places), turns, *axis[0], log_scale=True
        ),
        plot_curves(
            setting.out / "drift-distance.png", list(places), gaps, *axis[1], log_scale=True
        ),
    )
    return Report(
        "Drift over one long recording",
        data_kind(setting.dataset_path()),
        ("frames", "R_err_deg_first", "R_err_deg_last", "T_err_cm_first", "T_err_cm_last"),
        tuple(lines),
        figures,
        (f"medians over the first and the last of {_DRIFT_PARTS} equal parts",),
        "aerial",
    )


def _ends(frames: FollowedFrames, turns: Series, gaps: Series) -> Row:
    return {
        "frames": float(len(frames.stamps)),
        "R_err_deg_first": turns.values[0],
        "R_err_deg_last": turns.values[-1],
        "T_err_cm_first": gaps.values[0],
        "T_err_cm_last": gaps.values[-1],
    }


def _tracks(setting: Setting, tracker: str) -> list[list[PoseRecord]]:
    """The records of each object in each recording, in order."""
    run = setting.predict(tracker, "aerial")
    records = sorted(
        setting.stored(run, "aerial").records, key=lambda r: (r.sequence, r.object, r.frame)
    )
    return [list(one) for _, one in groupby(records, key=lambda r: (r.sequence, r.object))]
