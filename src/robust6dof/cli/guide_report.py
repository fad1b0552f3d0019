"""What `robust6dof guide` prints of its runs."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from robust6dof.simulation.outcome import Outcome


def line_of(outcome: Outcome, count: int, total: int) -> str:
    """A run in one line."""
    result = f"reached after {outcome.time_s:.1f} s" if outcome.reached else "not reached"
    tracking = ""
    if outcome.tracking_error_deg is not None and outcome.tracking_error_m is not None:
        tracking = (
            f"; pose error {outcome.tracking_error_deg:.1f} deg, "
            f"{100.0 * outcome.tracking_error_m:.1f} cm"
        )
    lag = "" if outcome.lag_m is None else f"; lag {100.0 * outcome.lag_m:.1f} cm"
    broken = "" if not outcome.limits_broken else f"; broke {', '.join(outcome.limits_broken)}"
    return (
        f"[{count}/{total}] seed {outcome.seed} ({outcome.category}): {result}; at the end "
        f"{100.0 * outcome.final_translation_m:.1f} cm, {outcome.final_rotation_rad:.3f} rad"
        f"{tracking}{lag}{broken}"
    )


def report(campaign: dict[str, Any], out: Path) -> None:
    """Print what a campaign came to."""
    rate = campaign["success_rate"]
    if rate is None:
        return
    parts = [f"{campaign['runs']} runs, {100.0 * rate:.0f} % reached the goal"]
    for key, text in (
        ("median_time_s", "median time {:.1f} s"),
        ("median_time_ratio", "{:.2f} times the bound"),
        ("worst_lag_m", "worst lag {:.3f} m"),
    ):
        if campaign[key] is not None:
            parts.append(text.format(campaign[key]))
    parts.append(f"limits broken in {len(campaign['limits_broken_seeds'])} runs")
    print(f"{', '.join(parts)}: {out}")
