"""Each rule of the `aerial` protocol, by hand."""

import numpy as np
import pytest

from evaluation.pose_records import EXTENTS, record
from robust6dof.evaluation.intervals import draw_by_counts
from robust6dof.evaluation.protocols.aerial import (
    counted_records,
    frame_values,
    mean_interval,
    score,
)
from robust6dof.evaluation.records import PoseBatch
from robust6dof.evaluation.scores import mean_rows
from robust6dof.frames import TrackState


def mean_of(*records):
    """Score with a perfect starting frame in front, which must not count."""
    return score([record(0), *records]).mean


def test_first_visible_frame_of_each_track_does_not_count():
    records = [
        record(0, visibility=0.05),
        record(1, shift_cm=50),
        record(2),
        record(0, object="object_1"),
        record(1, object="object_1"),
    ]
    counted = counted_records(records)
    assert [(r.object, r.frame) for r in counted] == [("object_0", 2), ("object_1", 1)]


def test_ten_percent_visibility_is_enough_and_less_is_not():
    counted = counted_records([record(0), record(1, visibility=0.1), record(2, visibility=0.0999)])
    assert [r.frame for r in counted] == [1]


def test_thresholds_are_inclusive_and_both_must_hold(monkeypatch):
    # 5 cm in floating point lies a hair above or below, so the margins are a nanometre wide.
    assert mean_of(record(turn_deg=5 - 1e-7, shift_cm=5 - 1e-7))["5deg5cm"] == 100
    assert mean_of(record(turn_deg=5 + 1e-7))["5deg5cm"] == 0
    assert mean_of(record(shift_cm=5 + 1e-7))["5deg5cm"] == 0
    assert mean_of(record(turn_deg=9.9, shift_cm=4.9))["10deg5cm"] == 100
    assert mean_of(record(turn_deg=9.9, shift_cm=5.1))["10deg5cm"] == 0
    batch = PoseBatch([record()], [False])
    for name in ("R_err_deg", "T_err_cm"):
        monkeypatch.setattr(batch, name, lambda: np.array([5.0]))
    assert frame_values(batch)["5deg5cm"].tolist() == [100]


def test_missing_counts_as_180_degrees_and_a_metre_and_fails_everything():
    mean = mean_of(record(1, missing=True), record(2, turn_deg=20, shift_cm=2))
    assert mean["lost"] == 50
    assert mean["R_err_deg"] == pytest.approx(100)
    assert mean["T_err_cm"] == pytest.approx(51)
    assert mean["R_err_deg_median"] == pytest.approx(100)
    lost = mean_of(record(1, missing=True))
    assert all(lost[f"IoU{t}"] == 0 for t in (25, 50, 75))
    assert lost["5deg5cm"] == lost["10deg5cm"] == 0


def test_a_pose_of_a_lost_tracker_is_missing():
    mean = mean_of(record(1, state=TrackState.LOST))
    assert (mean["lost"], mean["5deg5cm"], mean["R_err_deg"]) == (100, 0, 180)


def test_errors_are_not_gated_by_overlap():
    assert mean_of(record(shift_cm=40))["T_err_cm"] == pytest.approx(40)


@pytest.mark.parametrize(
    ("fields", "symmetric"),
    [
        ({"category": "bottle"}, True),
        ({"category": "bowl"}, True),
        ({"category": "can"}, True),
        ({"category": "camera"}, False),
        ({"category": "laptop"}, False),
        ({"category": "mug"}, False),
        ({"category": "mug", "handle_visible": False}, True),
        ({"category": "025_mug", "handle_visible": False}, True),
        ({"category": "camera", "handle_visible": False}, False),
        ({"category": "vase", "symmetric": True}, True),
    ],
)
def test_turn_about_y_costs_only_what_shows_it(fields, symmetric):
    mean = mean_of(record(turn_deg=90, axis="y", **fields))
    assert mean["R_err_deg"] == pytest.approx(0.0 if symmetric else 90.0, abs=1e-6)
    assert mean["5deg5cm"] == (100.0 if symmetric else 0.0)


def test_iou_uses_the_predicted_extents_under_all_three_names():
    mean = mean_of(record(extents=EXTENTS * 0.5))
    assert mean["IoU25_obb_exact"] == 0.0  # an eighth
    assert mean["IoU25"] == mean["IoU25_obb_exact"]
    assert mean["IoU25_aabb_fixed"] == 0.0
    assert mean["IoU25_nocs_official"] == 100.0  # the size hardly matters to it
    assert mean_of(record(extents=EXTENTS * 0.95))["IoU75"] == 100.0


def test_mean_is_over_categories_not_frames():
    records = [record(0), record(0, object="b", category="can")]
    records += [record(i) for i in range(1, 10)]
    records += [record(1, object="b", category="can", shift_cm=30)]
    scores = score(records)
    assert scores.mean["5deg5cm"] == pytest.approx(50)
    assert scores.per_category["camera"]["5deg5cm"] == 100
    assert scores.details["frames"] == 10


def test_per_difficulty():
    records = [
        record(f, sequence=s, difficulty=s, shift_cm=8 * (s == "hard"))
        for s in ("easy", "hard")
        for f in range(3)
    ]
    rows = score(records).details["per_difficulty"]
    assert (rows["easy"]["5deg5cm"], rows["hard"]["5deg5cm"]) == (100, 0)


def test_nothing_counted_is_undefined_not_zero():
    scores = score([record(0)])
    assert scores.mean == {}
    assert scores.details["frames"] == 0


def test_interval_draws_whole_sequences():
    """A hundred identical frames in each of n sequences say no more than n values."""
    rng = np.random.default_rng(0)
    truth = np.repeat(rng.random(30) < 0.5, 100) * 100.0
    sequences = np.repeat([f"s{i}" for i in range(30)], 100)
    interval = mean_interval({"x": truth}, np.full(3000, "can"), sequences)["x"]
    share = truth.mean() / 100
    half_width = 100 * 1.96 * np.sqrt(share * (1 - share) / 30)
    assert interval[1] - interval[0] == pytest.approx(2 * half_width, rel=0.15)
    assert interval[0] < truth.mean() < interval[1]


def test_interval_is_that_of_the_frames_of_the_drawn_sequences():
    rng = np.random.default_rng(1)
    value = rng.random(200)
    sequences = rng.choice(["a", "b", "c", "d"], 200)
    kinds = np.where(np.isin(sequences, ["a", "b"]), "can", rng.choice(["mug", "can"], 200))
    means = []
    for drawn in draw_by_counts(4, 1000):
        frames = np.concatenate([np.flatnonzero(sequences == "abcd"[i]) for i in drawn])
        of_kind = [value[frames[kinds[frames] == kind]] for kind in ("can", "mug")]
        means.append(np.mean([values.mean() for values in of_kind if len(values)]))
    interval = mean_interval({"x": value}, kinds, sequences)["x"]
    assert interval == pytest.approx(tuple(np.percentile(means, [2.5, 97.5])))


def test_one_sequence_has_no_interval():
    assert score([record(0), record(1)]).details["interval95"] == {}


def test_mean_rows_leaves_out_what_is_undefined():
    rows = {"a": {"x": 1.0, "y": float("nan")}, "b": {"x": 3.0, "y": float("nan")}}
    mean = mean_rows(rows)
    assert mean["x"] == 2.0
    assert np.isnan(mean["y"])
