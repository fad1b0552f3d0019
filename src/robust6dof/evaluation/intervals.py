"""How sure a mean is: the 95 % interval when whole sequences are drawn again.

Frames of one sequence are far from independent, so sequences are the unit of the bootstrap.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from robust6dof.evaluation.records import PoseRecord
from robust6dof.evaluation.scores import Row

Interval = dict[str, tuple[float, float]]
"""Metric → lower and upper end."""


def draw_sequences(count: int, replicates: int, seed: int = 0) -> np.ndarray:
    """Indices [replicates, count] of sequences, drawn with replacement."""
    return np.random.default_rng(seed).integers(0, count, (replicates, count))


def percentile_interval(rows: Sequence[Row]) -> Interval:
    """The middle 95 % of each metric over the replicates in which it is defined."""
    interval: Interval = {}
    for key in rows[0]:
        values = np.array([row.get(key, np.nan) for row in rows])
        values = values[np.isfinite(values)]
        if len(values):
            low, high = np.percentile(values, [2.5, 97.5])
            interval[key] = (float(low), float(high))
    return interval


def bootstrap_interval(
    records: Sequence[PoseRecord],
    mean: Callable[[Sequence[PoseRecord]], Row],
    replicates: int = 100,
    seed: int = 0,
) -> Interval:
    """Interval of a mean over records; empty with fewer than two sequences.

    Args:
        records: of all sequences.
        mean: the figures of a set of records.
        replicates: how many times the sequences are drawn; `mean` is asked as often.
        seed: of the draws.
    """
    groups: dict[str, list[PoseRecord]] = {}
    for record in records:
        groups.setdefault(record.sequence, []).append(record)
    if len(groups) < 2:
        return {}
    members = list(groups.values())
    rows = []
    for drawn in draw_sequences(len(members), replicates, seed):
        # A sequence drawn twice is two sequences: each has its own first frame and images.
        again = [
            replace(record, sequence=f"{record.sequence} ({copy})")
            for copy, index in enumerate(drawn)
            for record in members[index]
        ]
        rows.append(mean(again))
    return percentile_interval(rows)
