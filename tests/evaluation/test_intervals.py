"""The bootstrap draws whole sequences, and its interval is that of their means."""

from dataclasses import replace

import numpy as np
import pytest

from evaluation.pose_records import record
from robust6dof.evaluation import intervals
from robust6dof.evaluation.intervals import draw_sequences, percentile_interval
from robust6dof.evaluation.protocols import captra, find_protocol, ycbv_auc


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
    interval = captra.score(sequences(shifts)).details["interval95"]
    means = shifts[draw_sequences(4, 300)].mean(axis=1)
    assert interval["T_err_cm"] == pytest.approx(tuple(np.percentile(means, [2.5, 97.5])))


def drawn_records(records, drawn):
    """A sequence drawn twice is two sequences: each has its own first frame and images."""
    names = sorted({one.sequence for one in records})
    return [
        replace(one, sequence=f"{copy} {names[index]}")
        for copy, index in enumerate(drawn)
        for one in records
        if one.sequence == names[index]
    ]


@pytest.mark.parametrize("protocol", ["captra", "6pack", "6pack-fixed", "nocs-map", "wild6d"])
def test_the_interval_is_that_of_scoring_every_draw_from_scratch(protocol, monkeypatch):
    """Errors are measured and detections matched once; here they are for each draw anew."""
    rng = np.random.default_rng(4)
    records = [
        record(
            frame,
            sequence=f"s{i}",
            object=f"{category}_{number}",
            category=category,
            shift_cm=rng.uniform(0, 8),
            turn_deg=rng.uniform(0, 12),
            confidence=round(rng.random(), 1),
            missing=protocol != "captra" and rng.random() < 0.1,
        )
        for i, categories in enumerate((("can", "mug"), ("mug",), ("can", "camera")))
        for frame in range(3)
        for category in categories
        for number in range(2)
    ]
    draws = rng.integers(0, 3, (6, 3))
    monkeypatch.setattr(intervals, "draw_sequences", lambda *_: draws)
    score = find_protocol(protocol).score
    expected = percentile_interval([score(drawn_records(records, one)).mean for one in draws])
    found = score(records).details["interval95"]
    assert found.keys() == expected.keys()
    for key, ends in expected.items():
        assert found[key] == pytest.approx(ends), key


def test_one_sequence_has_no_interval():
    assert captra.score(sequences([1.0])).details["interval95"] == {}


def test_the_interval_of_an_auc_holds_its_value_and_narrows_with_more_sequences():
    points = np.random.default_rng(0).uniform(-0.05, 0.05, (30, 3))
    widths = []
    for copies in (1, 8):
        scores = ycbv_auc.score(sequences([0.5, 3.0, 6.0] * copies), {"can": points})
        low, high = scores.details["interval95"]["ADD_auc"]
        assert low <= scores.mean["ADD_auc"] <= high
        widths.append(high - low)
    assert widths[1] < 0.6 * widths[0]
