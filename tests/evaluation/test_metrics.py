"""ADD, ADD-S, VOCap and AP against naive references and cases done by hand."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from robust6dof.evaluation.metrics import (
    add,
    add_s,
    average_precision,
    rotation_err_deg,
    translation_err_cm,
    vocap_auc,
)
from robust6dof.geometry.transforms import transform_points


def random_poses(rng, n):
    T = np.tile(np.eye(4), (n, 1, 1))
    T[:, :3, :3] = Rotation.random(n, rng=rng).as_matrix()
    T[:, :3, 3] = rng.normal(size=(n, 3)) * 0.05
    return T


def test_rotation_error_ignores_the_turn_about_y_where_symmetric():
    T = np.tile(np.eye(4), (3, 1, 1))
    turned = T.copy()
    angles = [[0, 70, 0], [30, 70, 0], [0, 70, 0]]
    turned[:, :3, :3] = Rotation.from_euler("xyz", angles, degrees=True).as_matrix()
    errors = rotation_err_deg(turned, T, np.array([True, True, False]))
    # Extrinsic x then y: the y axis itself is tilted by 30° and the turn about y carries it along.
    np.testing.assert_allclose(errors, [0, 30, 70], atol=1e-9)


def test_translation_error_is_in_centimetres():
    T = np.tile(np.eye(4), (1, 1, 1))
    moved = T.copy()
    moved[0, :3, 3] = [0.03, 0.04, 0]
    np.testing.assert_allclose(translation_err_cm(moved, T), [5.0])


def test_add_and_add_s_agree_with_their_definitions():
    rng = np.random.default_rng(0)
    points, T, T_true = rng.normal(size=(60, 3)) * 0.05, random_poses(rng, 5), random_poses(rng, 5)
    for i in range(5):
        predicted, true = transform_points(T[i], points), transform_points(T_true[i], points)
        pairwise = np.linalg.norm(true[:, None] - predicted[None], axis=-1)
        one = slice(i, i + 1)
        assert add(points, T[one], T_true[one])[0] == pytest.approx(np.diag(pairwise).mean())
        assert add_s(points, T[one], T_true[one])[0] == pytest.approx(pairwise.min(axis=1).mean())


def test_add_works_in_chunks():
    rng = np.random.default_rng(1)
    points, T, T_true = rng.normal(size=(7, 3)), random_poses(rng, 600), random_poses(rng, 600)
    alone = [add(points, T[i : i + 1], T_true[i : i + 1])[0] for i in range(600)]
    np.testing.assert_allclose(add(points, T, T_true), alone)


def test_add_s_is_not_symmetric_in_truth_and_prediction():
    """The distance goes from each true point to the nearest predicted one, not the reverse."""
    points = np.array([[0.0, 0, 0], [1, 0, 0], [1.1, 0, 0]])
    T, T_true = np.eye(4)[None].copy(), np.eye(4)[None].copy()
    T[0, 0, 3] = 1.0
    assert add_s(points, T, T_true)[0] == pytest.approx((1.0 + 0 + 0.1) / 3)
    assert add_s(points, T_true, T)[0] == pytest.approx((0 + 0.9 + 1.0) / 3)


def vocap_by_integration(errors, max_error=0.1, steps=20_000):
    """Mean over thresholds of the share of errors at or below the *next* error: VOCap's steps
    take the accuracy at the right end of each interval."""
    thresholds = (np.arange(steps) + 0.5) / steps * max_error
    found = np.sort(errors[errors <= max_error])
    accuracy = np.minimum(np.searchsorted(found, thresholds) + 1, len(found)) / len(errors)
    return 100 * accuracy.mean() if len(found) else 0.0


def test_vocap_by_hand():
    # Errors 2 cm and 6 cm, one missing: accuracy 1/3 up to 2 cm, 2/3 up to 6 cm and beyond.
    expected = 100 * (0.02 * 1 / 3 + 0.04 * 2 / 3 + 0.04 * 2 / 3) / 0.1
    assert vocap_auc(np.array([0.06, np.inf, 0.02])) == pytest.approx(expected)
    assert vocap_auc(np.zeros(3)) == pytest.approx(100.0)
    assert vocap_auc(np.array([0.2, np.inf])) == 0.0
    assert np.isnan(vocap_auc(np.array([])))


def test_vocap_keeps_an_error_of_exactly_ten_centimetres():
    """Only errors *above* the maximum are lost: this one still raises the last accuracy."""
    assert vocap_auc(np.array([0.1])) == pytest.approx(100.0)
    assert vocap_auc(np.array([0.1 + 1e-9])) == 0.0


@given(st.lists(st.floats(0, 0.2), min_size=1, max_size=12))
def test_vocap_agrees_with_integration(errors):
    errors = np.array(errors)
    assert vocap_auc(errors) == pytest.approx(vocap_by_integration(errors), abs=0.1)


@given(st.lists(st.floats(0, 0.2), min_size=1, max_size=12), st.data())
def test_vocap_never_rises_when_an_error_grows(errors, data):
    errors = np.array(errors)
    worse = errors.copy()
    worse[data.draw(st.integers(0, len(errors) - 1))] += data.draw(st.floats(0, 0.2))
    assert vocap_auc(worse) <= vocap_auc(errors) + 1e-9


def ap_by_brute_force(scores, matched, truths):
    """Area under precision(recall), the best precision at any recall at least as large."""
    order = sorted(range(len(scores)), key=lambda k: -scores[k])
    hits, curve = 0, []
    for rank, k in enumerate(order, start=1):
        hits += bool(matched[k])
        curve.append((hits / truths, hits / rank))
    area, last = 0.0, 0.0
    for recall, _ in curve:
        area += (recall - last) * max(p for r, p in curve if r >= recall)
        last = recall
    return 100 * area


@settings(deadline=None)
@given(st.integers(0, 2**32 - 1), st.integers(1, 15), st.integers(0, 5))
def test_ap_agrees_with_brute_force(seed, predictions, missed):
    rng = np.random.default_rng(seed)
    scores = rng.permutation(predictions).astype(float)
    matched = rng.random((predictions, 3)) < 0.6
    truths = matched.sum(axis=0) + missed
    ap = average_precision(scores, matched, truths)
    for column in range(3):
        if truths[column] == 0:
            assert np.isnan(ap[column])
        else:
            expected = ap_by_brute_force(scores, matched[:, column], truths[column])
            assert ap[column] == pytest.approx(expected)


def test_ap_without_predictions():
    ap = average_precision(np.zeros(0), np.zeros((0, 2), bool), np.array([3, 0]))
    assert ap[0] == 0.0
    assert np.isnan(ap[1])
