"""An experiment's table with intervals, as Markdown and JSON."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field
from pathlib import Path

from robust6dof.evaluation.intervals import Interval
from robust6dof.evaluation.published import CAVEATS, PUBLISHED
from robust6dof.evaluation.report import markdown_table
from robust6dof.evaluation.scores import Row, Scores


@dataclass(frozen=True)
class Line:
    """One row of the table."""

    name: str
    values: Row
    interval: Interval = field(default_factory=dict)
    """95 %, by bootstrap over sequences; empty where there is one sequence or none of ours."""
    remark: str = ""


@dataclass(frozen=True)
class Report:
    """What an experiment found."""

    title: str
    data: str
    """What it was measured on, in words."""
    columns: tuple[str, ...]
    """Keys of the lines' values."""
    lines: tuple[Line, ...]
    figures: tuple[Path, ...] = ()
    notes: tuple[str, ...] = ()
    protocol: str = ""
    iou: str | None = None


def line_of(name: str, scores: Scores, remark: str = "") -> Line:
    """A row from scores, remarks of its run included."""
    return Line(name, scores.mean, scores.details.get("interval95", {}), remark)


def published_lines(protocol: str, comparable: bool) -> tuple[Line, ...]:
    """The published figures of a benchmark; where ours are of other images, each line says so."""
    return tuple(
        Line(one.method, one.figures, remark=one.beside(comparable))
        for one in PUBLISHED.get(protocol, ())
    )


def caveats(protocol: str) -> tuple[str, ...]:
    """What to mind about a benchmark's published figures."""
    return CAVEATS.get(protocol, ())


def write(report: Report, out: Path) -> None:
    """Write `table.md` and `results.json`."""
    out.mkdir(parents=True, exist_ok=True)
    (out / "table.md").write_text(markdown(report, out), encoding="utf-8")
    rows = [
        {
            "name": line.name,
            "values": {key: _plain(line.values.get(key)) for key in report.columns},
            "interval95": {k: v for k, v in line.interval.items() if k in report.columns},
            "remark": line.remark,
        }
        for line in report.lines
    ]
    found = {"title": report.title, "protocol": report.protocol, "iou": report.iou}
    found |= {"data": report.data, "rows": rows, "notes": list(report.notes)}
    (out / "results.json").write_text(json.dumps(found, indent=1, ensure_ascii=False) + "\n")


def markdown(report: Report, out: Path) -> str:
    """The table with what it was measured on, its figures and notes."""
    iou = f", IoU `{report.iou}`" if report.iou else ""
    protocol = f" Protocol `{report.protocol}`{iou}." if report.protocol else ""
    remarks = any(line.remark for line in report.lines)
    head = ["", *report.columns, *["remark"] * remarks]
    rows = [
        [line.name, *(_cell(line, key) for key in report.columns), *[line.remark] * remarks]
        for line in report.lines
    ]
    parts = [
        f"# {report.title}\n",
        f"Measured on: {report.data}.{protocol} In brackets: 95 % interval by bootstrap over "
        "sequences.\n",
        markdown_table(head, rows) if rows else "",
        *(f"![{path.stem}]({path.relative_to(out)})\n" for path in report.figures),
        *(f"- {note}" for note in dict.fromkeys(report.notes)),
    ]
    return "\n".join(parts) + "\n"


def _cell(line: Line, key: str) -> str:
    value = line.values.get(key, math.nan)
    if not math.isfinite(value):
        return "–"
    digits = 2 if abs(value) < 10 and ("err" in key or "M" in key) else 1
    ends = line.interval.get(key)
    interval = "" if ends is None else f" [{ends[0]:.{digits}f}, {ends[1]:.{digits}f}]"
    return f"{value:.{digits}f}{interval}"


def _plain(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None
