"""How sure a mean is: the 95 % interval when whole sequences are drawn again.

Frames of one sequence are far from independent, so sequences are the unit of the bootstrap.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from robust6dof.evaluation.scores import Row

Interval = dict[str, tuple[float, float]]
"""Metric → lower and upper end."""


def draw_sequences(count: int, replicates: int, seed: int = 0) -> np.ndarray:
    """Indices [replicates, count] of sequences, drawn with replacement."""
    return np.random.default_rng(seed).integers(0, count, (replicates, count))


def draw_by_counts(count: int, replicates: int, seed: int = 0) -> list[np.ndarray]:
    """As `draw_sequences`, from the stream of random numbers behind `aerial`'s published figures:
    how often each sequence is drawn comes from one multinomial number each."""
    share = np.full(count, 1 / count)
    counts = np.random.default_rng(seed).multinomial(count, share, replicates)
    return [np.repeat(np.arange(count), drawn) for drawn in counts]


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
    sequences: Sequence[str],
    mean: Callable[[np.ndarray], Row],
    replicates: int = 300,
    seed: int = 0,
    draw: Callable[[int, int, int], Iterable[np.ndarray]] | None = None,
) -> Interval:
    """Interval of a mean over rows; empty with fewer than two sequences.

    Args:
        sequences: name of each row's sequence.
        mean: figures of the rows of these indices; a row that is given twice counts as two.
        replicates: how many times the sequences are drawn; `mean` is asked as often.
        seed: of the draws.
        draw: indices of the sequences of each replicate; `draw_sequences` if not given.
    """
    names, sequence = np.unique(np.asarray(sequences, str), return_inverse=True)
    if len(names) < 2:
        return {}
    members = [np.flatnonzero(sequence == index) for index in range(len(names))]
    draws = (draw or draw_sequences)(len(names), replicates, seed)
    return percentile_interval(
        [mean(np.concatenate([members[i] for i in drawn])) for drawn in draws]
    )
