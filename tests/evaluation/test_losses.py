"""Losses, how they are noticed and how they end: hand-made recordings whose counts are known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from robust6dof.evaluation.calibration import reliability
from robust6dof.evaluation.losses import FollowedFrames, LossCounts, count_losses, runs


def followed(count: int = 120, **changes: np.ndarray) -> FollowedFrames:
    """A track without a fault at 30 Hz."""
    zeros = np.zeros(count)
    whole = FollowedFrames(
        stamps=np.arange(count) / 30.0,
        R_err_deg=zeros,
        T_err_cm=zeros,
        visible=np.ones(count),
        claimed=np.ones(count, bool),
        called_lost=np.zeros(count, bool),
    )
    return replace(whole, **changes)


def where(count: int, start: int, end: int, inside: float, outside: float) -> np.ndarray:
    values = np.full(count, outside)
    values[start:end] = inside
    return values


def test_a_faultless_track_has_no_loss_and_no_alarm() -> None:
    assert count_losses(followed()) == LossCounts(good_frames=120)


def test_an_object_out_of_view_is_one_loss_noticed_and_found_again() -> None:
    hidden = where(120, 30, 60, 0.0, 1.0)
    claimed = ~where(120, 34, 62, 1.0, 0.0).astype(bool)
    counts = count_losses(followed(visible=hidden, claimed=claimed, called_lost=~claimed))
    assert (counts.losses, counts.noticed, counts.returns, counts.found) == (1, 1, 1, 1)
    assert counts.wrong_locks == 1, "four frames of TRACKING while it was out of view"


def test_who_claims_on_for_six_frames_did_not_notice() -> None:
    hidden = where(120, 30, 60, 0.0, 1.0)
    for last_claim, noticed in ((35, 1), (36, 0)):
        claimed = ~where(120, last_claim, 60, 1.0, 0.0).astype(bool)
        assert count_losses(followed(visible=hidden, claimed=claimed)).noticed == noticed


def test_a_loss_of_five_frames_is_neither_noticed_nor_overlooked() -> None:
    counts = count_losses(followed(visible=where(120, 30, 35, 0.0, 1.0)))
    assert (counts.losses, counts.brief, counts.noticed) == (1, 1, 0)
    assert np.isnan(counts.row()["noticed_in_5"])


def test_an_error_counts_from_its_third_frame_on() -> None:
    short = followed(R_err_deg=where(120, 30, 32, 30.0, 0.0))
    assert count_losses(short).losses == 0
    long = followed(T_err_cm=where(120, 30, 50, 15.0, 0.0))
    np.testing.assert_array_equal(np.flatnonzero(long.lost), np.arange(32, 50))


def test_no_number_is_an_error() -> None:
    assert count_losses(followed(T_err_cm=np.full(120, np.nan))).losses == 1


def test_an_error_in_view_is_a_slip_and_no_return() -> None:
    for end, mended in ((50, 1), (90, 0)):
        counts = count_losses(followed(R_err_deg=where(120, 30, end, 40.0, 0.0)))
        assert (counts.slips, counts.mended, counts.returns) == (1, mended, 0)


def test_one_lucky_frame_neither_ends_a_loss_nor_restarts_its_clock() -> None:
    wrong = where(120, 20, 80, 90.0, 0.0)
    wrong[50] = 0.0
    counts = count_losses(followed(visible=where(120, 20, 40, 0.0, 1.0), R_err_deg=wrong))
    assert (counts.losses, counts.returns, counts.found) == (1, 1, 1), "right once within a second"
    wrong[50] = 90.0
    visible = where(120, 20, 40, 0.0, 1.0)
    visible[55] = 0.49
    counts = count_losses(followed(visible=visible, R_err_deg=wrong))
    assert (counts.returns, counts.found) == (1, 0), "the flicker starts no new second"


def test_a_pose_found_too_late_or_not_claimed_is_not_found() -> None:
    hidden = where(120, 20, 40, 0.0, 1.0)
    for found_at, found in ((69, 1), (75, 0)):
        wrong = where(120, 20, found_at, 90.0, 0.0)
        assert count_losses(followed(visible=hidden, R_err_deg=wrong)).found == found
    silent = where(120, 20, 120, 1.0, 0.0).astype(bool)
    assert count_losses(followed(visible=hidden, called_lost=silent, claimed=~silent)).found == 0


def test_a_return_of_less_than_half_a_second_is_not_judged() -> None:
    for frames, returns in ((54, 0), (57, 1)):
        hidden = where(frames, 20, 40, 0.0, 1.0)
        assert count_losses(followed(frames, visible=hidden)).returns == returns


def test_alarms_are_counted_once_each_and_silence_by_the_frame() -> None:
    claimed = np.ones(120, bool)
    claimed[[0, 50, 51, 80]] = False
    counts = count_losses(followed(claimed=claimed))
    assert (counts.false_alarms, counts.silent_frames) == (3, 4)


def test_who_never_claims_anything_is_seen_to_be_silent() -> None:
    row = count_losses(followed(claimed=np.zeros(120, bool))).row()
    assert row["silent"] == pytest.approx(100.0)


def test_counts_add_up_to_shares() -> None:
    row = (
        LossCounts(losses=3, noticed=2, good_frames=500, false_alarms=1)
        + LossCounts(losses=1, noticed=1)
    ).row()
    assert row["noticed_in_5"] == pytest.approx(75.0)
    assert row["alarms_per_1000"] == pytest.approx(2.0)
    assert np.isnan(row["found_in_1s"])


def test_runs() -> None:
    assert runs(np.array([1, 1, 0, 0, 1], bool)) == [(0, 2), (4, 5)]
    assert runs(np.zeros(3, bool)) == []


def test_a_calibrated_confidence_has_no_error_and_an_overconfident_one_has() -> None:
    rng = np.random.default_rng(0)
    confidence = rng.uniform(size=60_000)
    right = rng.uniform(size=60_000) < confidence
    assert reliability(confidence, right).expected_error < 0.01
    always = reliability(np.full(1000, 0.9), np.arange(1000) < 500)
    assert always.expected_error == pytest.approx(0.4)
    assert len(always.count) == 15
    assert always.count.sum() == 1000


def test_the_frames_about_a_loss_raise_no_alarm_but_are_silent() -> None:
    hidden = where(120, 30, 60, 0.0, 1.0)
    silent = where(120, 28, 62, 1.0, 0.0).astype(bool)
    silent[100] = True
    counts = count_losses(followed(visible=hidden, claimed=~silent))
    assert (counts.false_alarms, counts.silent_frames) == (1, 5)
