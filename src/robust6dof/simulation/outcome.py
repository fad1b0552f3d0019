"""What a run came to, and what a campaign of runs did."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from robust6dof.servo.config import PadServoConfig
from robust6dof.simulation.guidance import GuidanceConfig, GuidanceRun
from robust6dof.simulation.judge import Arrival, GoalError
from robust6dof.simulation.trace import Trace

_SETTLED = 20.0
"""From then on a followed target's distance counts as lag [s]."""


@dataclass(frozen=True)
class Outcome:
    """One run. Judged on simulation truth; `_estimated` is what the pose source believed."""

    seed: int
    category: str
    reached: bool
    """Both errors came below their thresholds, and stayed."""
    time_s: float | None
    """When; None if not reached."""
    final_rotation_rad: float
    final_translation_m: float
    reached_estimated: bool
    time_s_estimated: float | None
    final_rotation_rad_estimated: float | None
    final_translation_m_estimated: float | None
    tracking_error_deg: float | None
    """Median angle of the estimate from the truth in the same image (of the axis, where
    symmetric)."""
    tracking_error_m: float | None
    """Median distance."""
    time_ratio: float | None
    """time_s over the time that pure exponential convergence takes from this start."""
    tracker_ms: float | None
    """Median computing time of the tracker."""
    lag_m: float | None
    """95th percentile of the true translation error after the first 20 s; None for shorter runs."""
    touched: bool
    """The vehicle ran into the table, the floor or the object."""

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)


def judge_run(seed: int, category: str, run: GuidanceRun, config: GuidanceConfig) -> Outcome:
    """Sum a run up."""
    trace = run.trace
    estimated = _arrival(trace, "estimated", config)
    # The estimate is an image's age behind: a stay that the run's end cuts short counts.
    estimated_at = estimated.since if estimated.first is None else estimated.first
    bound = time_bound(trace, config.servo)
    return Outcome(
        seed=seed,
        category=category,
        reached=run.reached_at is not None,
        time_s=run.reached_at,
        final_rotation_rad=float(trace.rows[-1]["true_rotation_error_rad"]),
        final_translation_m=float(trace.rows[-1]["true_translation_error_m"]),
        reached_estimated=estimated_at is not None,
        time_s_estimated=estimated_at,
        final_rotation_rad_estimated=_last(trace, "estimated_rotation_error_rad"),
        final_translation_m_estimated=_last(trace, "estimated_translation_error_m"),
        tracking_error_deg=_median(np.degrees(trace.column("tracking_error_rad"))),
        tracking_error_m=_median(trace.column("tracking_error_m")),
        time_ratio=None if run.reached_at is None or bound <= 0 else run.reached_at / bound,
        tracker_ms=_median(trace.column("tracker_ms")),
        lag_m=_lag(trace),
        touched=run.touched,
    )


def time_bound(trace: Trace, config: PadServoConfig) -> float:
    """max(ln(e_p / δ_T) / λ_p, ln(e_r / δ_R) / λ_r) from the first true errors [s].

    The time of exponential convergence at the law's rates. The law's translation error is
    (x, y, log Z), not metres, so that this is a yardstick and no strict bound.
    """
    e_p = float(trace.rows[0]["true_translation_error_m"])
    e_r = float(trace.rows[0]["true_rotation_error_rad"])
    translation = np.log(max(e_p / config.delta_T, 1.0)) / config.lambda_p
    rotation = np.log(max(e_r / config.delta_R, 1.0)) / config.lambda_r
    return float(max(translation, rotation))


def sum_up(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """A campaign's figures: runs, success_rate, median_time_s over successes, and medians."""
    successes = [outcome for outcome in outcomes if outcome.reached]
    return {
        "runs": len(outcomes),
        "success_rate": len(successes) / len(outcomes) if outcomes else None,
        "median_time_s": _middle([outcome.time_s for outcome in successes]),
        "median_time_ratio": _middle([outcome.time_ratio for outcome in successes]),
        "median_tracking_error_deg": _middle([o.tracking_error_deg for o in outcomes]),
        "median_tracking_error_m": _middle([o.tracking_error_m for o in outcomes]),
        "median_lag_m": _middle([outcome.lag_m for outcome in outcomes]),
        "touched": sum(outcome.touched for outcome in outcomes),
        "failed_seeds": [outcome.seed for outcome in outcomes if not outcome.reached],
    }


def _arrival(trace: Trace, prefix: str, config: GuidanceConfig) -> Arrival:
    arrival = Arrival(config.servo, config.hold)
    for row in trace.rows:
        place = [float(row[f"{prefix}_translation_error_{axis}_m"]) for axis in "xyz"]
        turn = [float(row[f"{prefix}_rotation_error_{axis}_rad"]) for axis in "xyz"]
        error = GoalError(np.array(place), np.array(turn))
        arrival = arrival.seen(float(row["time_s"]), error)
    return arrival


def _lag(trace: Trace) -> float | None:
    late = trace.column("true_translation_error_m")[trace.column("time_s") > _SETTLED]
    return float(np.percentile(late, 95)) if len(late) >= 100 else None


def _last(trace: Trace, name: str) -> float | None:
    value = float(trace.rows[-1][name])
    return value if np.isfinite(value) else None


def _median(values: np.ndarray) -> float | None:
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if len(finite) else None


def _middle(values: Sequence[float | None]) -> float | None:
    present = [value for value in values if value is not None]
    return float(np.median(present)) if present else None
