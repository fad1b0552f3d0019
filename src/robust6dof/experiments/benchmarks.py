"""The comparison tables: estimation mAP, tracking, YCB-Video, YCBInEOAT, Wild6D."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from robust6dof.evaluation.cad_models import find_cad_mesh
from robust6dof.evaluation.data_kind import RECORDED, data_kind
from robust6dof.evaluation.evaluate import Stored, default_models
from robust6dof.evaluation.model_points import read_model_points
from robust6dof.evaluation.protocols import find_protocol
from robust6dof.evaluation.report import plot_curves as plot_score_curves
from robust6dof.evaluation.scores import Scores
from robust6dof.experiments.report import Line, Report, caveats, line_of, published_lines
from robust6dof.experiments.setting import Setting
from robust6dof.shapes.sampling import sample_surface

_POSES = ("5deg2cm", "5deg5cm", "10deg2cm", "10deg5cm")


def estimation(setting: Setting) -> Report:
    """Table of category-level estimation, and the mAP curves of each category."""
    columns = ("IoU25", "IoU50", "IoU75", *_POSES)
    return _detection_table(setting, "Pose estimation: mAP", "nocs-map", columns)


def wild6d(setting: Setting) -> Report:
    """Table of Wild6D: single views, per category and averaged."""
    columns = ("IoU50", "5deg2cm", "5deg5cm", "10deg5cm")
    return _detection_table(setting, "Wild6D: mAP", "wild6d", columns)


def _detection_table(
    setting: Setting, title: str, protocol: str, columns: tuple[str, ...]
) -> Report:
    """Single views from true masks are estimates; the tracked poses of the same frames are a row
    of their own, which says so."""
    lines, figures = [], []
    every = setting.size.view_every
    for tracker in setting.trackers:
        run = setting.predict(tracker, protocol, "views", single_view=True, every=every)
        scores = setting.scores(run, protocol)
        lines.append(line_of(tracker, scores, "single views, true masks as detections"))
        figures.append(_curves(scores, tracker, setting.out / f"curves-{tracker}-views.png"))
    tracked = setting.scores(setting.predict(setting.tracker, protocol), protocol)
    lines.append(line_of(setting.tracker, tracked, "tracked from a true start: not an estimate"))
    figures.append(
        _curves(tracked, setting.tracker, setting.out / f"curves-{setting.tracker}-tracked.png")
    )
    lines += _per_category(tracked, f"{setting.tracker}, tracked")
    return _report(setting, title, protocol, columns, lines, figures, tracked)


def tracking(setting: Setting) -> Report:
    """Table of category-level tracking, by 6-PACK's protocol."""
    columns = ("5deg5cm", "IoU25", "R_err_deg", "T_err_cm")
    runs = {name: setting.predict(name, "6pack") for name in setting.trackers}
    all_scores = {name: setting.scores(run, "6pack") for name, run in runs.items()}
    lines = [line_of(name, scores) for name, scores in all_scores.items()]
    first = all_scores[setting.tracker]
    lines += _per_category(first, setting.tracker)
    figures = [
        _curves(scores, name, setting.out / f"curves-{name}.png")
        for name, scores in all_scores.items()
    ]
    return _report(setting, "Pose tracking", "6pack", columns, lines, figures, first)


def ycb_video(setting: Setting) -> Report:
    """Table of ADD and ADD-S AUC for each object, by the rules of YCB-Video."""
    return _instance_table(setting, "ADD and ADD-S: YCB-Video's rules", "ycbv-auc")


def ycbineoat(setting: Setting) -> Report:
    """Table of ADD and ADD-S AUC for each object, by the rules of YCBInEOAT."""
    return _instance_table(setting, "ADD and ADD-S: YCBInEOAT's rules", "ycbineoat-auc")


def _instance_table(setting: Setting, title: str, protocol: str) -> Report:
    columns = ("ADD_auc", "ADDS_auc")
    lines: list[Line] = []
    scores = None
    for tracker in setting.trackers:
        stored = setting.stored(setting.predict(tracker, protocol), protocol)
        one = _point_scores(setting, stored, protocol)
        lines.append(line_of(tracker, one, "pooled over all pairs"))
        lines.append(Line(tracker, one.details["object_mean"], remark="mean of the objects"))
        scores = scores or one
    assert scores is not None  # there is always the tracker in question
    lines += _per_category(scores, setting.tracker)
    figure = _curves(scores, setting.tracker, setting.out / "curves.png")
    return _report(setting, title, protocol, columns, lines, [figure], scores)


def _point_scores(setting: Setting, stored: Stored, protocol: str) -> Scores:
    """With the official points where they are, else with points drawn on each recording's mesh."""
    path = setting.dataset_path()
    models = setting.models or default_models(path / "run", path)
    score = find_protocol(protocol).score
    if models is not None:
        return score(
            stored.records, read_model_points(models, {r.category for r in stored.records})
        )
    records = [replace(r, category=f"{r.sequence}/{r.category}") for r in stored.records]
    points: dict[str, np.ndarray] = {}
    folders = (setting.meshes,) if setting.meshes else ()
    for sequence in setting.dataset().sequences:
        for truth in sequence.truth(0):
            mesh = find_cad_mesh(sequence, truth, folders)
            drawn = sample_surface(mesh, 1500, np.random.default_rng(setting.seed))[0]
            points[f"{sequence.name}/{truth.category}"] = drawn + truth.box_center
    return score(records, points)


def _per_category(scores: Scores, name: str) -> list[Line]:
    return [Line(f"{name}: {label}", row) for label, row in scores.per_category.items()]


def _curves(scores: Scores, tracker: str, path: Path) -> Path:
    return plot_score_curves(replace(scores, tracker=tracker), path)


def _report(
    setting: Setting,
    title: str,
    protocol: str,
    columns: tuple[str, ...],
    lines: list[Line],
    figures: list[Path],
    scores: Scores,
) -> Report:
    """With the published lines beside, which were measured on the benchmark itself."""
    kind = data_kind(setting.dataset_path())
    return Report(
        title,
        kind,
        columns,
        (*lines, *published_lines(protocol, comparable=kind == RECORDED)),
        tuple(figures),
        (*scores.notes, *caveats(protocol)),
        protocol,
        scores.iou,
    )
