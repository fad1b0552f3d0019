"""Seeds, resuming, and the sum of a campaign."""

from dataclasses import replace

import pytest

from robust6dof.errors import InputError
from robust6dof.simulation.campaign import finished, parse_seeds, run_all, store
from robust6dof.simulation.outcome import Outcome, sum_up

GOOD = Outcome(
    seed=1,
    category="mug",
    reached=True,
    time_s=10.0,
    final_rotation_rad=0.05,
    final_translation_m=0.02,
    reached_estimated=True,
    time_s_estimated=10.2,
    final_rotation_rad_estimated=0.04,
    final_translation_m_estimated=0.02,
    tracking_error_deg=1.5,
    tracking_error_m=0.004,
    time_ratio=1.1,
    tracker_ms=20.0,
    lag_m=None,
    steady_tracking_rad=0.02,
    steady_tracking_m=0.004,
    steady_control_rad=0.03,
    steady_control_m=0.02,
    energy_linear=1.0,
    energy_angular=0.5,
    limits_broken=("tilt",),
    touched=False,
)
BAD = replace(GOOD, seed=2, reached=False, time_s=None, time_ratio=None)


def fly_nowhere(seed: int) -> Outcome:
    return replace(GOOD, seed=seed)


def test_seeds_are_read_as_one_a_range_or_a_list():
    assert parse_seeds("7") == (7,)
    assert parse_seeds("0..3") == (0, 1, 2, 3)
    assert parse_seeds("4, 1..2,4") == (4, 1, 2)


@pytest.mark.parametrize("text", ["", "a", "3..1", "-1", "1..", "1-4"])
def test_other_seeds_are_refused(text):
    with pytest.raises(InputError, match="seeds"):
        parse_seeds(text)


def test_a_finished_seed_is_known_again_while_its_settings_stay(tmp_path):
    assert finished(tmp_path, {"law": "coupled"}) is None
    store(tmp_path, GOOD, {"law": "coupled"})
    assert finished(tmp_path, {"law": "coupled"}) == GOOD
    assert finished(tmp_path, {"law": "printed"}) is None
    (tmp_path / "summary.json").write_text('{"seed": 1')  # a run that was cut short
    assert finished(tmp_path, {"law": "coupled"}) is None


def test_times_are_of_successes_only():
    campaign = sum_up([GOOD, BAD, replace(GOOD, seed=3, time_s=20.0)])
    assert campaign["runs"] == 3
    assert campaign["success_rate"] == pytest.approx(2 / 3)
    assert campaign["median_time_s"] == 15.0
    assert campaign["failed_seeds"] == [2]


def test_a_campaign_without_success_has_no_time():
    campaign = sum_up([BAD])
    assert campaign["success_rate"] == 0.0
    assert campaign["median_time_s"] is None


@pytest.mark.parametrize("processes", [1, 2])
def test_all_seeds_are_flown(processes):
    outcomes = run_all(fly_nowhere, [4, 5, 6], processes)
    assert sorted(outcome.seed for outcome in outcomes) == [4, 5, 6]
