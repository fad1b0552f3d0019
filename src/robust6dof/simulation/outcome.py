"""What a run came to, and what a campaign of runs did."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool

from robust6dof.robot.arm import Arm
from robust6dof.servo.config import PadServoConfig
from robust6dof.simulation.guidance import GuidanceConfig, GuidanceRun
from robust6dof.simulation.judge import Arrival, GoalError
from robust6dof.simulation.limits import broken_limits
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
    steady_tracking_rad: float | None
    """Median error of the pose source once settled (the run's last second, or all after 20 s) …"""
    steady_tracking_m: float | None
    steady_control_rad: float | None
    """… and of the loop around it: how far from the goal the servo believed to be."""
    steady_control_m: float | None
    energy_linear: float
    """∫ ‖v‖² dt of the commanded vehicle velocity [m²/s]."""
    energy_angular: float
    """∫ (ω_z² + ‖η̇‖²) dt of the commanded yaw and joint rates [rad²/s]."""
    limits_broken: tuple[str, ...]
    """Which limits did not hold at some moment (`simulation.limits`)."""
    touched: bool
    """The vehicle ran into the table, the floor or the object."""

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)


def judge_run(
    seed: int, category: str, run: GuidanceRun, config: GuidanceConfig, arm: Arm
) -> Outcome:
    """Sum a run of this arm up."""
    trace = run.trace
    estimated = _arrival(trace, "estimated", config)
    # The estimate is an image's age behind: a stay that the run's end cuts short counts.
    estimated_at = estimated.since if estimated.first is None else estimated.first
    bound = time_bound(trace, config.servo)
    steady = _steady(trace)
    linear, angular = command_energy(trace, config.servo.period)
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
        steady_tracking_rad=_median(trace.column("tracking_error_rad")[steady]),
        steady_tracking_m=_median(trace.column("tracking_error_m")[steady]),
        steady_control_rad=_median(trace.column("estimated_rotation_error_rad")[steady]),
        steady_control_m=_median(trace.column("estimated_translation_error_m")[steady]),
        energy_linear=linear,
        energy_angular=angular,
        limits_broken=broken_limits(trace, config, arm),
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


def command_energy(trace: Trace, period: float) -> tuple[float, float]:
    """∫ ‖v‖² dt [m²/s] and ∫ (ω_z² + ‖η̇‖²) dt [rad²/s] of what was commanded."""
    linear = trace.columns("vx_cmd_m_s", "vy_cmd_m_s", "vz_cmd_m_s")
    joints = [f"joint{i}_rate_cmd_rad_s" for i in range(1, 5)]
    angular = trace.columns("wz_cmd_rad_s", *joints)
    return float((linear**2).sum() * period), float((angular**2).sum() * period)


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
        "worst_lag_m": max((o.lag_m for o in outcomes if o.lag_m is not None), default=None),
        "median_steady_tracking_rad": _middle([o.steady_tracking_rad for o in outcomes]),
        "median_steady_tracking_m": _middle([o.steady_tracking_m for o in outcomes]),
        "median_steady_control_rad": _middle([o.steady_control_rad for o in outcomes]),
        "median_steady_control_m": _middle([o.steady_control_m for o in outcomes]),
        "median_energy_linear": _middle([outcome.energy_linear for outcome in outcomes]),
        "median_energy_angular": _middle([outcome.energy_angular for outcome in outcomes]),
        "limits_broken_seeds": [outcome.seed for outcome in outcomes if outcome.limits_broken],
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


def _steady(trace: Trace) -> Bool[np.ndarray, "T"]:
    time = trace.column("time_s")
    return time > min(_SETTLED, float(time[-1]) - 1.0)


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
