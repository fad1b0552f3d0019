"""How a tracker loses an object, whether it notices, and whether it finds it again.

One recording at a time; the first frame, in which the tracker was told, is left out. The object is
*lost* while under 5 % of it are visible, and where the error is over 20° or 10 cm for three frames
or more, from the third on; gaps of under three frames do not end a loss. It *returns* when half of
it is visible again after under 5 % were, and stays so for half a second.
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
        """Over 20° or 10 cm off, or no number at all."""
        return ~((self.R_err_deg <= 20.0) & (self.T_err_cm <= 10.0))

    @property
    def hidden(self) -> Bool[np.ndarray, "F"]:
        """Under 5 % visible."""
        return self.visible < 0.05

    @property
    def losses(self) -> list[tuple[int, int]]:
        """Begin and end (exclusive) of each."""
        away = self.hidden.copy()
        for start, end in runs(self.wrong):
            if end - start >= _PATIENCE:
                away[start:end] = True
        return [self._noticeable(start, end) for start, end in runs(_bridged(away))]

    def _noticeable(self, start: int, end: int) -> tuple[int, int]:
        """An error is a loss from its third frame on, a hidden object at once."""
        hidden = np.flatnonzero(self.hidden[start:end])
        first = int(hidden[0]) if len(hidden) else end - start
        return start + min(first, _PATIENCE - 1), end

    @property
    def lost(self) -> Bool[np.ndarray, "F"]:
        """Within a loss."""
        lost = np.zeros(len(self.stamps), bool)
        for start, end in self.losses:
            lost[start:end] = True
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
    brief: int = 0
    """Over within five frames, in which there is no saying whether they were noticed."""
    noticed: int = 0
    """Of the others: within five frames the tracker no longer says TRACKING."""
    returns: int = 0
    found: int = 0
    """Of these, the pose is within 20° and 10 cm, and not called lost, within the first second, and
    before the object is hidden again."""
    slips: int = 0
    """Losses without anything hidden: errors."""
    mended: int = 0
    """Of these, the pose is right again, as above, within a second."""
    wrong_locks: int = 0
    """Runs of three frames or more that say TRACKING, while wrong or unseen."""
    good_frames: int = 0
    silent_frames: int = 0
    """Good frames on which the tracker does not say TRACKING."""
    false_alarms: int = 0
    """Runs of these, but for those that lead into a loss by three frames or less, and the second
    after one, in which the object may be found again."""

    def __add__(self, other: LossCounts) -> LossCounts:
        return LossCounts(*(getattr(self, f.name) + getattr(other, f.name) for f in fields(self)))

    def row(self) -> Row:
        """As the shares that are reported [%]."""
        return {
            "losses": float(self.losses),
            "noticed_in_5": _percent(self.noticed, self.losses - self.brief),
            "returns": float(self.returns),
            "found_in_1s": _percent(self.found, self.returns),
            "slips": float(self.slips),
            "mended_in_1s": _percent(self.mended, self.slips),
            "wrong_locks_per_loss": _percent(self.wrong_locks, self.losses),
            "good_frames": float(self.good_frames),
            "silent": _percent(self.silent_frames, self.good_frames),
            "alarms_per_1000": 10.0 * _percent(self.false_alarms, self.good_frames),
        }


def count_losses(frames: FollowedFrames) -> LossCounts:
    """Losses of one object in one recording."""
    losses, claimed = frames.losses, frames.claimed
    judged = [start for start, end in losses if end - start > _NOTICE_FRAMES]
    slips = [start for start, end in losses if not frames.hidden[start:end].any()]
    returns = _returns(frames)
    silent = frames.good & ~claimed
    return LossCounts(
        losses=len(losses),
        brief=len(losses) - len(judged),
        noticed=sum(not claimed[start : start + _NOTICE_FRAMES + 1].all() for start in judged),
        returns=len(returns),
        found=sum(_is_right_soon(frames, start, end) for start, end in returns),
        slips=len(slips),
        mended=sum(_is_right_soon(frames, start, len(claimed)) for start in slips),
        wrong_locks=sum(end - start >= _PATIENCE for start, end in runs(claimed & frames.lost)),
        good_frames=int(frames.good.sum()),
        silent_frames=int(silent.sum()),
        false_alarms=len(runs(silent & ~_about_losses(frames, losses))),
    )


def runs(flags: Bool[np.ndarray, "F"]) -> list[tuple[int, int]]:
    """Begin and end (exclusive) of each run of true ones."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(np.int8), [0]])))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _bridged(flags: Bool[np.ndarray, "F"]) -> Bool[np.ndarray, "F"]:
    """With the gaps of under three frames filled."""
    filled = flags.copy()
    for (_, end), (start, _) in itertools.pairwise(runs(flags)):
        if start - end < _PATIENCE:
            filled[end:start] = True
    return filled


def _returns(frames: FollowedFrames) -> list[tuple[int, int]]:
    """The stretches in which the object is in view again."""
    seen, found = runs(_bridged(frames.visible >= 0.5)), []
    for number, (start, end) in enumerate(seen):
        before = seen[number - 1][1] if number else 0
        lasts = frames.stamps[end - 1] - frames.stamps[start] >= _LEAST_RETURN_S
        if lasts and frames.hidden[before:start].any():
            found.append((start, end))
    return found


def _about_losses(frames: FollowedFrames, losses: list[tuple[int, int]]) -> Bool[np.ndarray, "F"]:
    """Within a loss, three frames before it, or the second after it."""
    about = np.zeros(len(frames.stamps), bool)
    for start, end in losses:
        over = frames.stamps[min(end, len(about) - 1)] + _FIND_S
        about[max(start - _PATIENCE, 0) : end] = True
        about[end:] |= frames.stamps[end:] <= over
    return about


def _is_right_soon(frames: FollowedFrames, start: int, end: int) -> bool:
    soon = frames.stamps[start:end] <= frames.stamps[start] + _FIND_S
    return bool((soon & ~frames.wrong[start:end] & ~frames.called_lost[start:end]).any())


def _percent(part: int, whole: int) -> float:
    return 100.0 * part / whole if whole else float("nan")
