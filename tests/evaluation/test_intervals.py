"""The bootstrap draws whole sequences, and its interval is that of their means."""

import numpy as np
import pytest

from evaluation.pose_records import record
from robust6dof.evaluation.intervals import bootstrap_interval, draw_sequences, percentile_interval
from robust6dof.evaluation.protocols import captra, ycbv_auc


def test_percentiles_leave_out_what_is_undefined():
    rows = [{"a": float(i), "b": float("nan")} for i in range(101)] + [
        {"a": float("nan"), "b": 1.0}
    ]
    interval = percentile_interval(rows)
    assert interval["a"] == pytest.approx((2.5, 97.5))
    assert interval["b"] == (1.0, 1.0)


def sequences(shifts_cm, frames=4):
    return [
        record(frame, sequence=f"s{i}", category="can", shift_cm=shift)
        for i, shift in enumerate(shifts_cm)
        for frame in range(frames)
    ]


def test_the_interval_is_that_of_means_over_drawn_sequences():
    shifts = np.array([1.0, 2.0, 7.0, 9.0])
    interval = bootstrap_interval(
        sequences(shifts), lambda drawn: captra.score(drawn).mean, replicates=200
    )
    means = shifts[draw_sequences(4, 200)].mean(axis=1)
    assert interval["T_err_cm"] == pytest.approx(tuple(np.percentile(means, [2.5, 97.5])))


def test_a_sequence_drawn_twice_has_two_first_frames():
    counts = []
    bootstrap_interval(
        sequences([1.0, 2.0], frames=3),
        lambda drawn: counts.append(len(captra.without_first_frames(drawn))) or {"x": 0.0},
        replicates=5,
    )
    assert counts == [4] * 5


def test_one_sequence_has_no_interval():
    assert bootstrap_interval(sequences([1.0]), lambda drawn: {"x": 0.0}) == {}


def test_the_interval_of_an_auc_holds_its_value_and_narrows_with_more_sequences():
    points = np.random.default_rng(0).uniform(-0.05, 0.05, (30, 3))
    widths = []
    for copies in (1, 8):
        scores = ycbv_auc.score(sequences([0.5, 3.0, 6.0] * copies), {"can": points})
        low, high = scores.details["interval95"]["ADD_auc"]
        assert low <= scores.mean["ADD_auc"] <= high
        widths.append(high - low)
    assert widths[1] < 0.6 * widths[0]
