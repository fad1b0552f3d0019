"""What a protocol returns, and its file `scores.json`."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

Row = dict[str, float]
"""Metric name → value; percentages 0–100, degrees, centimetres; NaN where undefined."""


@dataclass(frozen=True)
class Scores:
    """The figures of one tracker on one data set under one protocol."""

    protocol: str
    iou: str | None
    """Which IoU the keys `IoU25`… hold; None where the protocol has none."""
    mean: Row
    """The protocol's own headline: mostly the unweighted mean over the categories."""
    per_category: dict[str, Row]
    details: dict[str, Any] = field(default_factory=dict)
    """Counts, other means, intervals, curves: what only this protocol has."""
    notes: tuple[str, ...] = ()
    """What must be read beside the figures."""
    data: str = ""
    tracker: str = ""

    def write(self, path: Path) -> None:
        """Write as JSON, null for what is undefined."""
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(_plain(asdict(self)), indent=1, ensure_ascii=False) + "\n")


def mean_rows(rows: Mapping[str, Row]) -> Row:
    """Unweighted mean over the rows, key by key, of what is defined."""
    keys = dict.fromkeys(key for row in rows.values() for key in row)
    return {key: _mean([row[key] for row in rows.values() if key in row]) for key in keys}


def _mean(values: list[float]) -> float:
    defined = [value for value in values if not math.isnan(value)]
    return float(np.mean(defined)) if defined else math.nan


def percent(condition: np.ndarray) -> float:
    """Share of True, 0 to 100; NaN of nothing."""
    return 100.0 * float(np.mean(condition)) if len(condition) else math.nan


def average(values: np.ndarray) -> float:
    """Mean; NaN of nothing."""
    return float(np.mean(values)) if len(values) else math.nan


def cumulative(errors: np.ndarray, axis: np.ndarray) -> list[float]:
    """Percentage of the errors at or below each value of `axis`: an accuracy curve."""
    if len(errors) == 0:
        return [math.nan] * len(axis)
    return (100.0 * np.searchsorted(np.sort(errors), axis, side="right") / len(errors)).tolist()


def _plain(value: Any) -> Any:
    """Numbers and containers that JSON knows; NaN and infinity become null."""
    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [_plain(item) for item in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
