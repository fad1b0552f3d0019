"""Transitions between what a tracker believes of itself.

TRACKING → UNCERTAIN when the confidence falls below `sure`, and back after `patience` frames at
or above it; either → LOST after `patience` frames below `lost`; LOST → RECOVERING on the first
frame at or above `sure`; RECOVERING → TRACKING after `patience` such frames, or after
`unplaced_patience` where nothing but the object says that it is the right one; back to LOST on one
that is not.
"""

from __future__ import annotations

from dataclasses import dataclass

from robust6dof.frames import TrackState

FOLLOWED = (TrackState.TRACKING, TrackState.UNCERTAIN)
"""In which nothing doubts that it is the right object."""


@dataclass(frozen=True)
class StateRules:
    """Thresholds on the confidence."""

    sure: float = 0.5
    lost: float = 0.2
    patience: int = 3
    """Frames in a row."""
    unplaced_patience: int = 15
    """Of an object found again elsewhere than where it stood, or where the place is not known."""


@dataclass(frozen=True)
class StateCount:
    """Frames in a row at or above `sure`, and below `lost`."""

    good: int = 0
    bad: int = 0

    def after(self, confidence: float, rules: StateRules) -> StateCount:
        """With one more frame."""
        good = self.good + 1 if confidence >= rules.sure else 0
        bad = self.bad + 1 if confidence < rules.lost else 0
        return StateCount(good, bad)


def next_state(
    state: TrackState, count: StateCount, rules: StateRules, stands: bool = True
) -> TrackState:
    """The state after a frame, whose confidence `count` already holds.

    Args:
        state: before.
        count: with the frame.
        rules: thresholds.
        stands: what is found again stands where the lost object stood.
    """
    if state not in FOLLOWED:
        if not count.good:
            return TrackState.LOST
        enough = rules.patience if stands else rules.unplaced_patience
        return TrackState.TRACKING if count.good >= enough else TrackState.RECOVERING
    if count.bad >= rules.patience:
        return TrackState.LOST
    enough = rules.patience if state is TrackState.UNCERTAIN else 1
    return TrackState.TRACKING if count.good >= enough else TrackState.UNCERTAIN
