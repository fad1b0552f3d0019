"""Second loop, last part: scores as files: JSON, a Markdown table beside the published, plots."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from robust6dof.evaluation.data_kind import RECORDED
from robust6dof.evaluation.published import CAVEATS, PUBLISHED
from robust6dof.evaluation.scores import Row, Scores

_AXIS_LABELS = {
    "rotation": "rotation error [deg]",
    "translation": "translation error [cm]",
    "iou": "IoU",
    "distance": "mean point distance [cm]",
}
_POINT_REMARKS = {
    "every_point": "pooled, with every model point: the toolbox's rule",
    "every_third_point": "pooled, with every third model point",
}


def write_report(out: Path, scores: Sequence[Scores]) -> list[Path]:
    """Write `scores.json` (in a folder per tracker where there are several), `table.md`, plots."""
    written: list[Path] = []
    for one in scores:
        folder = out if len(scores) == 1 else out / one.tracker
        one.write(folder / "scores.json")
        written.append(folder / "scores.json")
        if one.details.get("curves"):
            written.append(plot_curves(one, folder / "curves.png"))
    (out / "table.md").write_text(markdown(scores), encoding="utf-8")
    return [*written, out / "table.md"]


def markdown(scores: Sequence[Scores]) -> str:
    """The whole page: ours beside the published, per category, intervals, what to mind."""
    first = scores[0]
    rows = [(f"**{one.tracker}**", one.mean, _headline_remark(one)) for one in scores]
    for one in scores:
        if "object_mean" in one.details:
            remark = "unweighted mean of the objects"
            rows.append((f"**{one.tracker}**", one.details["object_mean"], remark))
        for key, remark in _POINT_REMARKS.items():
            if key in one.details:
                rows.append((f"**{one.tracker}**", one.details[key], remark))
    comparable = all(one.details.get("data_kind", RECORDED) == RECORDED for one in scores)
    for line in PUBLISHED.get(first.protocol, ()):
        rows.append((line.method, line.figures, line.beside(comparable)))
    iou = f", IoU `{first.iou}`" if first.iou else ""
    parts = [
        f"# {first.data or 'scores'}: protocol `{first.protocol}`{iou}\n",
        _metric_table("method", first, rows),
        *(_sections(one) for one in scores),
        _notes([note for one in scores for note in one.notes], CAVEATS.get(first.protocol, ())),
    ]
    return "\n".join(part for part in parts if part)


def _headline_remark(scores: Scores) -> str:
    stride = scores.details.get("point_stride", 1)
    parts = [scores.details.get("mean_is", ""), f"each {stride}. model point" * (stride > 1)]
    return "; ".join(part for part in parts if part)


def _sections(scores: Scores) -> str:
    parts = [f"## {scores.tracker}: per category\n"]
    parts.append(_metric_table("category", scores, _plain_rows(scores.per_category)))
    difficulties: dict[str, Row] = scores.details.get("per_difficulty", {})
    if difficulties:
        parts.append(f"## {scores.tracker}: per difficulty\n")
        parts.append(_metric_table("difficulty", scores, _plain_rows(difficulties)))
    interval: dict[str, Any] = scores.details.get("interval95", {})
    if interval:
        count = scores.details["sequences"]
        parts.append(f"## {scores.tracker}: 95 % interval (bootstrap over {count} sequences)\n")
        parts.append(_interval_table(scores, interval))
    return "\n".join(parts)


def _plain_rows(rows: dict[str, Row]) -> list[tuple[str, Row, str]]:
    return [(name, row, "") for name, row in rows.items()]


def _metric_table(head: str, scores: Scores, rows: list[tuple[str, Row, str]]) -> str:
    """One line a row; the remarks make a last column where there are any."""
    keys = _columns(scores)
    remarks = any(remark for _, _, remark in rows)
    heads = [head, *(_heading(key, scores.iou) for key in keys), *["remark"] * remarks]
    lines = [
        [name, *(_number(row.get(key, math.nan)) for key in keys), *[remark] * remarks]
        for name, row, remark in rows
    ]
    return markdown_table(heads, lines)


def _interval_table(scores: Scores, interval: dict[str, Any]) -> str:
    lines = [
        [_heading(key, scores.iou), _number(scores.mean[key]), "{:.1f} – {:.1f}".format(*ends)]
        for key, ends in interval.items()
        if key in _columns(scores)
    ]
    return markdown_table(["metric", "mean", "interval"], lines)


def _columns(scores: Scores) -> list[str]:
    """The metrics, without the headline IoU's second name."""
    return [key for key in scores.mean if not key.endswith(f"_{scores.iou}")]


def _heading(key: str, iou: str | None) -> str:
    """No IoU stands without its name."""
    if "IoU" not in key:
        return key
    threshold, _, name = key.removeprefix("mean_").partition("_")
    prefix = "mean " if key.startswith("mean_") else ""
    return f"{prefix}{threshold} {name or iou}"


def _number(value: float) -> str:
    return f"{value:.1f}" if math.isfinite(value) else "–"


def markdown_table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table."""
    lines = [head, ["---"] * len(head), *rows]
    return "".join("| " + " | ".join(cells) + " |\n" for cells in lines)


def _notes(notes: Sequence[str], caveats: Sequence[str]) -> str:
    lines = [f"- {text}\n" for text in dict.fromkeys([*notes, *caveats])]
    return "## To mind\n\n" + "".join(lines) if lines else ""


def plot_curves(scores: Scores, path: Path) -> Path:
    """One panel for each axis of `details["curves"]`, one line for each category."""
    from matplotlib.figure import Figure

    axes: dict[str, Any] = scores.details["curve_axes"]
    figure = Figure(figsize=(4.6 * len(axes), 3.8), layout="constrained")
    panels = figure.subplots(1, len(axes), squeeze=False)[0]
    for panel, (name, values) in zip(panels, axes.items(), strict=True):
        for label, curves in scores.details["curves"].items():
            panel.plot(values, curves[name], label=label)
        label = _AXIS_LABELS[name]
        panel.set(xlabel=f"{label} ({scores.iou})" if name == "iou" else label, ylim=(0, 102))
        panel.set_xlim(values[0], values[-1])
        panel.grid(alpha=0.3)
    is_map = scores.protocol in ("nocs-map", "wild6d")
    panels[0].set_ylabel("AP [%]" if is_map else "frames within [%]")
    panels[-1].legend(fontsize="small")
    figure.suptitle(f"{scores.tracker} on {scores.data}, protocol {scores.protocol}")
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=120)
    return path
