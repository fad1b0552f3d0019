"""Several laws side by side, flown from the same starts."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from robust6dof.evaluation.report import markdown_table

_COLUMNS: tuple[tuple[str, str, float, str], ...] = (
    ("reached [%]", "success_rate", 100.0, ".1f"),
    ("time [s]", "median_time_s", 1.0, ".1f"),
    ("over bound", "median_time_ratio", 1.0, ".2f"),
    ("lag p95 [cm]", "median_lag_m", 100.0, ".1f"),
    ("worst [cm]", "worst_lag_m", 100.0, ".1f"),
    ("tracking [cm]", "median_steady_tracking_m", 100.0, ".2f"),
    ("[rad]", "median_steady_tracking_rad", 1.0, ".3f"),
    ("control [cm]", "median_steady_control_m", 100.0, ".2f"),
    ("[rad]", "median_steady_control_rad", 1.0, ".3f"),
    ("energy [m²/s]", "median_energy_linear", 1.0, ".2f"),
    ("[rad²/s]", "median_energy_angular", 1.0, ".2f"),
)
"""Heading, key of `outcome.sum_up`, factor, format."""


def law_table(campaigns: Mapping[str, Mapping[str, Any]]) -> str:
    """A Markdown table: a row for each law, medians over its runs."""
    rows = []
    for law, campaign in campaigns.items():
        cells = [_cell(campaign[key], factor, form) for _, key, factor, form in _COLUMNS]
        broken = str(len(campaign["limits_broken_seeds"]))
        rows.append([law, str(campaign["runs"]), *cells, broken])
    return markdown_table(["law", "runs", *(name for name, *_ in _COLUMNS), "limits broken"], rows)


def _cell(value: float | None, factor: float, form: str) -> str:
    return "–" if value is None else format(factor * value, form)
