"""How a tracker loses an object, whether it notices, and whether it finds it again.

One recording at a time; the first frame, in which the tracker was told, is left out. A frame is
*lost* where under 5 % of the object are visible, or where the error has been over 20° or 10 cm for
three frames. A *loss* is a run of lost frames; gaps of under three frames do not end it.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
from jaxtyping import Bool, Float

from robust6dof.evaluation.records import PoseBatch, PoseRecord
from robust6dof.evaluation.scores import Row
from robust6dof.frames import TrackState

_PATIENCE = 3
"""Frames in a row that make a loss, a lock or a gap."""
_NOTICE_FRAMES = 5
_FIND_S = 1.0
_LEAST_RETURN_S = 0.5
_RATE_HZ = 30.0
"""Where a recording has no stamps."""


@dataclass(frozen=True, eq=False)
class FollowedFrames:
    """One object in one recording, frame by frame."""

    stamps: Float[np.ndarray, "F"]
    """[s]"""
    R_err_deg: Float[np.ndarray, "F"]
    T_err_cm: Float[np.ndarray, "F"]
    visible: Float[np.ndarray, "F"]
    """Share of the silhouette, 0 to 1."""
    claimed: Bool[np.ndarray, "F"]
    """The tracker says TRACKING."""
    called_lost: Bool[np.ndarray, "F"]
    """It says LOST."""

    @staticmethod
    def of(records: Sequence[PoseRecord]) -> FollowedFrames:
        """From the records of one object, in order; the first is left out."""
        records = records[1:]
        batch = PoseBatch(records, [record.symmetric for record in records])
        stamps = [
            record.frame / _RATE_HZ if record.stamp is None else record.stamp for record in records
        ]
        return FollowedFrames(
            np.array(stamps, float),
            batch.R_err_deg(),
            batch.T_err_cm(),
            np.array([record.visibility for record in records], float),
            np.array([record.state is TrackState.TRACKING for record in records], bool),
            np.array([record.lost for record in records], bool),
        )

    @property
    def wrong(self) -> Bool[np.ndarray, "F"]:
        """Over 20° or 10 cm off."""
        return (self.R_err_deg > 20.0) | (self.T_err_cm > 10.0)

    @property
    def lost(self) -> Bool[np.ndarray, "F"]:
        """See the module."""
        lost = self.visible < 0.05
        for start, end in runs(self.wrong):
            lost[start + _PATIENCE - 1 : end] = True
        return lost

    @property
    def right(self) -> Bool[np.ndarray, "F"]:
        """Within 10° and 5 cm."""
        return (self.R_err_deg <= 10.0) & (self.T_err_cm <= 5.0)

    @property
    def good(self) -> Bool[np.ndarray, "F"]:
        """Right, and at least half visible."""
        return self.right & (self.visible >= 0.5)


@dataclass(frozen=True)
class LossCounts:
    """Sums over recordings."""

    losses: int = 0
    noticed: int = 0
    """Within five frames the tracker no longer says TRACKING, or the loss is over."""
    returns: int = 0
    """Losses after which the object is at least half visible for half a second."""
    found: int = 0
    """Of these, the pose is within 20° and 10 cm, and not called lost, within the first second, and
    before the object is hidden again."""
    wrong_locks: int = 0
    """Runs of three frames or more that say TRACKING, while wrong or unseen."""
    good_frames: int = 0
    false_alarms: int = 0
    """Times that the tracker stops saying TRACKING on a good frame."""

    def __add__(self, other: LossCounts) -> LossCounts:
        return LossCounts(*(getattr(self, f.name) + getattr(other, f.name) for f in fields(self)))

    def row(self) -> Row:
        """As the shares that are reported [%]."""
        return {
            "losses": float(self.losses),
            "noticed_in_5": _percent(self.noticed, self.losses),
            "returns": float(self.returns),
            "found_in_1s": _percent(self.found, self.returns),
            "wrong_locks_per_loss": _percent(self.wrong_locks, self.losses),
            "good_frames": float(self.good_frames),
            "alarms_per_1000": 10.0 * _percent(self.false_alarms, self.good_frames),
        }


def count_losses(frames: FollowedFrames) -> LossCounts:
    """Losses of one object in one recording."""
    lost, claimed = frames.lost, frames.claimed
    losses = _merged(runs(lost))
    starts = [start for start, _ in losses]
    returns = [
        _return(frames, start, until) for start, until in itertools.pairwise([*starts, len(lost)])
    ]
    back = [one for one in returns if one is not None]
    alarms = frames.good[1:] & ~claimed[1:] & claimed[:-1]
    return LossCounts(
        losses=len(losses),
        noticed=sum(_is_noticed(claimed, start, end) for start, end in losses),
        returns=len(back),
        found=sum(back),
        wrong_locks=sum(end - start >= _PATIENCE for start, end in runs(claimed & lost)),
        good_frames=int(frames.good.sum()),
        false_alarms=int(alarms.sum()),
    )


def runs(flags: Bool[np.ndarray, "F"]) -> list[tuple[int, int]]:
    """Begin and end (exclusive) of each run of true ones."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(np.int8), [0]])))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _merged(losses: list[tuple[int, int]]) -> list[tuple[int, int]]:
    merged: list[tuple[int, int]] = []
    for start, end in losses:
        if merged and start - merged[-1][1] < _PATIENCE:
            merged[-1] = (merged[-1][0], end)
        else:
            merged.append((start, end))
    return merged


def _is_noticed(claimed: np.ndarray, start: int, end: int) -> bool:
    if end - start <= _NOTICE_FRAMES and end < len(claimed):
        return True
    return not claimed[start : start + _NOTICE_FRAMES + 1].all()


def _return(frames: FollowedFrames, start: int, until: int) -> bool | None:
    """Whether the object is found again; None where it does not come back for long enough."""
    seen = frames.visible >= 0.5
    for begin, end in runs(seen[start:until]):
        first, last = start + begin, start + end - 1
        if frames.stamps[last] - frames.stamps[first] < _LEAST_RETURN_S:
            continue
        soon = frames.stamps[first : last + 1] <= frames.stamps[first] + _FIND_S
        right = ~frames.wrong[first : last + 1] & ~frames.called_lost[first : last + 1]
        return bool((soon & right).any())
    return None


def _percent(part: int, whole: int) -> float:
    return 100.0 * part / whole if whole else float("nan")
