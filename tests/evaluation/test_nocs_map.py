"""Each rule of `nocs-map` and `wild6d`, by hand and against a literal loop."""

import numpy as np
import pytest

from evaluation.pose_records import EXTENTS, TRUE_POSE, record
from robust6dof.evaluation.detections import Boxes, Image, images_from_records
from robust6dof.evaluation.metrics import average_precision
from robust6dof.evaluation.protocols import nocs_map, wild6d
from robust6dof.evaluation.protocols.nocs_map import (
    CENTIMETRES,
    DEGREES,
    IOUS,
    match_iou,
    match_pose,
    score_images,
)


def boxes(*shifts_cm, category="camera", scores=None, turn=None):
    T = np.tile(TRUE_POSE, (len(shifts_cm), 1, 1))
    T[:, 0, 3] += np.array(shifts_cm) / 100
    scores = np.ones(len(shifts_cm)) if scores is None else np.array(scores, float)
    return Boxes(
        [category] * len(shifts_cm),
        T,
        np.tile(EXTENTS, (len(shifts_cm), 1)),
        scores,
        np.ones(len(shifts_cm), bool),
    )


def loop_match_iou(iou, threshold):
    """The rule in words: best score first, the best free truth, strictly above."""
    taken, partner = set(), []
    for row in iou:
        free = [j for j in range(len(row)) if j not in taken]
        best = max(free, key=lambda j: row[j], default=None)
        if best is None or not row[best] > threshold:
            partner.append(-1)
        else:
            taken.add(best)
            partner.append(best)
    return partner


def loop_match_pose(R, T, a, b):
    taken, matched = set(), []
    for i in range(len(R)):
        free = [j for j in range(R.shape[1]) if j not in taken and R[i, j] <= a and T[i, j] <= b]
        matched.append(bool(free))
        if free:
            taken.add(min(free, key=lambda j: R[i, j] + T[i, j]))
    return matched


def test_matching_agrees_with_the_literal_loops():
    rng = np.random.default_rng(0)
    for _ in range(20):
        predictions, truths = rng.integers(0, 5, 2)
        iou = rng.random((predictions, truths))
        partner = match_iou(iou)
        for column in range(0, 101, 10):
            assert partner[:, column].tolist() == loop_match_iou(iou, IOUS[column])
        R, T = 60 * rng.random((predictions, truths)), 10 * rng.random((predictions, truths))
        if truths == 0:
            continue
        matched = match_pose(R, T).reshape(predictions, len(DEGREES), len(CENTIMETRES))
        for a in range(0, 62, 9):
            for b in range(0, 22, 5):
                expected = loop_match_pose(R, T, DEGREES[a], CENTIMETRES[b])
                assert matched[:, a, b].tolist() == expected


def test_iou_match_is_strict_and_pose_match_inclusive():
    assert match_iou(np.array([[0.25]]))[0, 25] == -1
    assert match_iou(np.array([[0.25]]))[0, 24] == 0
    matched = match_pose(np.array([[5.0]]), np.array([[5.0]]))
    assert matched.reshape(len(DEGREES), len(CENTIMETRES))[5, 10]


def test_a_missed_object_costs_iou_but_not_pose():
    images = [Image("a", boxes(0.0), boxes(0.0)), Image("b", boxes(), boxes(0.0))]
    row = score_images(images).per_category["camera"]
    assert row["IoU25"] == pytest.approx(50)
    assert row["5deg5cm"] == pytest.approx(100)


def test_a_prediction_unmatched_at_iou_10_leaves_the_pose_ap():
    """Far away it is a false positive of IoU and nothing to pose AP."""
    images = [Image("a", boxes(300.0, 0.0, scores=[0.9, 0.5]), boxes(0.0))]
    row = score_images(images).per_category["camera"]
    assert row["IoU25"] == pytest.approx(50)
    assert row["5deg5cm"] == pytest.approx(100)


def test_second_detection_of_one_truth_is_a_false_positive():
    images = [
        Image("a", boxes(0.0, 1.0, scores=[0.9, 0.8]), boxes(0.0)),
        Image("b", boxes(0.0, scores=[0.7]), boxes(0.0)),
    ]
    row = score_images(images).per_category["camera"]
    # Hit, false positive, hit: precision 1 up to recall ½, then 2/3.
    assert row["IoU50"] == pytest.approx(100 * (0.5 + 0.5 * 2 / 3))


def test_other_classes_predictions_do_not_match():
    images = [Image("a", boxes(0.0, category="can"), boxes(0.0))]
    scores = score_images(images)
    assert list(scores.per_category) == ["camera"]
    assert scores.mean["IoU25"] == 0
    assert np.isnan(scores.mean["5deg5cm"])  # no truth was matched: nothing left to score


@pytest.mark.parametrize(("visible", "expected"), [(True, 0), (False, 100)])
def test_a_mug_is_symmetric_only_while_its_handle_hides(visible, expected):
    mug = record(turn_deg=90, axis="y", category="mug", handle_visible=visible)
    assert nocs_map.score([mug]).mean["5deg5cm"] == expected


def test_wild6d_takes_every_handle_as_visible_and_every_score_as_one():
    mug = record(turn_deg=90, axis="y", category="mug", handle_visible=False)
    assert wild6d.score([mug]).mean["5deg5cm"] == 0
    good, bad = record(1, confidence=0.1), record(2, confidence=0.9, shift_cm=7)
    # Ties keep their order, so the good one comes first however unsure it is.
    assert wild6d.score([good, bad]).mean["5deg5cm"] == pytest.approx(50)
    assert wild6d.score([good]).iou == "aabb_fixed"


def test_scores_rank_over_the_whole_set():
    good, bad = record(1, confidence=0.1), record(2, confidence=0.9, shift_cm=7)
    row = nocs_map.score([good, bad]).mean
    # The confident miss comes first: precision ½ at recall ½.
    assert row["5deg5cm"] == pytest.approx(25)


def test_headlines_read_the_right_thresholds():
    row = nocs_map.score([record(turn_deg=7, shift_cm=3)]).mean
    assert (row["5deg2cm"], row["5deg5cm"], row["10deg2cm"], row["10deg5cm"]) == (0, 0, 0, 100)


def test_mean_of_classes_and_images_without_predictions():
    records = [record(1), record(2, missing=True), record(3, category="can", object="b")]
    scores = nocs_map.score(records)
    assert len(images_from_records(records)) == 3
    assert scores.per_category["camera"]["IoU50"] == pytest.approx(50)
    assert scores.mean["IoU50"] == pytest.approx(75)


def test_curves_rise_with_their_threshold():
    rng = np.random.default_rng(1)
    records = [
        record(i, turn_deg=rng.uniform(0, 40), shift_cm=rng.uniform(0, 8), confidence=rng.random())
        for i in range(40)
    ]
    curves = nocs_map.score(records).details["curves"]["camera"]
    assert (np.diff(curves["rotation"]) >= 0).all()
    assert (np.diff(curves["translation"]) >= 0).all()
    assert (np.diff(curves["iou"]) <= 0).all()
    assert len(curves["rotation"]) == 61
    assert len(curves["translation"]) == 21


def test_average_precision_keeps_order_of_equal_scores():
    matched = np.array([[True], [False]])
    assert average_precision(np.ones(2), matched, np.array([1]))[0] == 100
    assert average_precision(np.ones(2), matched[::-1], np.array([1]))[0] == 50
