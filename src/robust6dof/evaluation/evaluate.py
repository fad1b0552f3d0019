"""Second loop: score stored poses, ours or other people's, under a named protocol."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from robust6dof.data.dataset import Dataset
from robust6dof.data.truth_file import open_with_truth
from robust6dof.errors import InputError
from robust6dof.evaluation.data_kind import RECORDED, data_kind
from robust6dof.evaluation.detections import Image
from robust6dof.evaluation.frame_choice import FrameChoice
from robust6dof.evaluation.icg_poses import icg_methods, read_icg_poses
from robust6dof.evaluation.model_points import read_model_points
from robust6dof.evaluation.protocols import Protocol
from robust6dof.evaluation.protocols.nocs_map import score_images
from robust6dof.evaluation.protocols.ycbineoat_auc import align_first_frame
from robust6dof.evaluation.records import PoseRecord
from robust6dof.evaluation.result_formats import BopCsv, ObInCam, SixPackText, read_nocs_results
from robust6dof.evaluation.run_info import RunInfo
from robust6dof.evaluation.run_records import (
    gaps_of_run,
    make_records,
    read_run_info,
    records_of_run,
)
from robust6dof.evaluation.scores import Scores

_THIRD = 3
_POINT_ROWS = {1: "every_point", _THIRD: "every_third_point"}
"""Stride → its key in `details`; the one that is not the headline is given beside."""
_PACK_NOTE = (
    "the headline of this pack is that of its check figures, with every third model point on both "
    "sides; the row with every point is YCB_Video_toolbox's rule, to compare other results with"
)
FORMATS = ("run", "icg", "nocs", "6pack", "ob_in_cam", "bop")


@dataclass(frozen=True)
class Stored:
    """Poses read from disk, with the truth beside them."""

    tracker: str
    data: str
    records: Sequence[PoseRecord] = ()
    images: Sequence[Image] = field(default=())
    """Instead of records, where predictions are not assigned to truths (NOCS results)."""
    remarks: tuple[str, ...] = ()
    """What must be said beside the figures."""
    point_stride: int = 1
    """ADD and ADD-S of these are measured with each n-th model point where nothing else is said."""
    kind: str = RECORDED
    """What their images are; see `data_kind`."""


def recognise_format(path: Path) -> str:
    """Which of FORMATS a path holds.

    Raises:
        InputError: there is no such path.
    """
    if not path.exists():
        raise InputError(f"{path} does not exist")
    if path.is_file():
        return "bop" if path.suffix == ".csv" else "icg"
    if (path / "run.json").is_file():
        return "run"
    if any(path.glob("temp_*")):
        return "6pack"
    return "nocs" if any(path.glob("**/results_*.pkl")) else "ob_in_cam"


def read_stored(
    path: Path,
    protocol: Protocol,
    data: Path | None = None,
    method: str | None = None,
    form: str | None = None,
    sequences: Collection[str] = (),
) -> list[Stored]:
    """Read stored poses in any of FORMATS; several where a pack holds several methods.

    Args:
        path: run folder, ICG's zip, NOCS results, 6-PACK text, ob_in_cam folders, BOP csv.
        protocol: what they are to be scored by.
        data: where the truth is; the formats `icg` and `nocs` bring their own.
        method: which method of a pack; all when not given. Else the tracker's name.
        form: one of FORMATS; recognised when not given.
        sequences: of the data set, only these; all if empty. Not for `icg` and `nocs`.

    Raises:
        DataError: unreadable, or fitting no truth.
        InputError: `data` is needed, or the format does not go with the protocol.
    """
    form = form or recognise_format(path)
    if form in ("icg", "nocs") and sequences:
        raise InputError(f"poses in the format '{form}' are scored whole, not by sequences")
    if form == "icg":
        methods = [method] if method else icg_methods(path)
        return [_icg(path, name) for name in methods]
    if form == "nocs":
        return [Stored(method or path.name, "nocs", images=read_nocs_results(path))]
    info = read_run_info(path) if form == "run" else None
    place = data or (Path(info.data) if info else None)
    if place is None:
        raise InputError(f"poses in the format '{form}' bring no truth: give --data")
    dataset = protocol.truth(open_with_truth(place, with_masks=False).only(sequences))
    if info is None:
        stored = Stored(
            method or path.stem,
            _data_name(dataset),
            _foreign_records(path, form, dataset, protocol),
        )
    else:
        stored = _run(path, info, dataset, protocol)
    return [_about_data(replace(stored, tracker=method or stored.tracker), data_kind(place))]


def _run(path: Path, info: RunInfo, whole: Dataset, protocol: Protocol) -> Stored:
    dataset = info.frames.of(whole)
    records = records_of_run(path, dataset, protocol.keyframes_only)
    name = f"{info.tracker} (started as {info.protocol})"
    tracker = info.tracker if info.protocol == protocol.name else name
    gaps = gaps_of_run(path, [sequence.name for sequence in dataset.sequences])
    return Stored(tracker, _data_name(dataset), records, remarks=(*gaps, *_remarks(info)))


def _data_name(dataset: Dataset) -> str:
    """Recordings go by their folder; the others are one known data set each."""
    known = dataset.name != "recordings"
    return dataset.name if known else f"{dataset.path.resolve().name} ({dataset.name})"


def _about_data(stored: Stored, kind: str) -> Stored:
    """Say what kind of data the truth is of, and what follows for comparisons."""
    if kind == RECORDED:
        return stored
    remark = f"measured on {kind}: not comparable with figures on real images"
    return replace(stored, kind=kind, remarks=(remark, *stored.remarks))


def _icg(path: Path, method: str) -> Stored:
    """The pack's check figures, 53.7 / 75.2 for PoseCNN, are those of every third point."""
    records = read_icg_poses(path, method)
    return Stored(method, "ycb-video", records, remarks=(_PACK_NOTE,), point_stride=_THIRD)


def _remarks(info: RunInfo) -> tuple[str, ...]:
    """What of a run's making must be said beside its figures."""
    remarks = [info.remark] if info.remark else []
    if info.frames != FrameChoice():
        remarks.append(f"only part of the frames: {info.frames}")
    if info.single_view:
        remarks.append("an estimate of each frame by itself, from its true mask: not tracked")
    if info.init_noise or info.all_noise:
        remarks.append(f"pose noise: Init×{info.init_noise:g}, All×{info.all_noise:g}")
    return tuple(remarks)


def _foreign_records(
    path: Path, form: str, dataset: Dataset, protocol: Protocol
) -> list[PoseRecord]:
    readers = {"6pack": SixPackText, "ob_in_cam": ObInCam, "bop": BopCsv}
    records = list(make_records(dataset, readers[form](path), protocol.keyframes_only))
    if not any(record.T_cam_obj is not None for record in records):
        raise InputError(f"{path} holds no pose of any frame of {dataset.path}")
    return records


def score_stored(
    stored: Stored,
    protocol: Protocol,
    models: Path | None = None,
    point_stride: int | None = None,
    align_first: bool = False,
) -> Scores:
    """Score under a protocol.

    Args:
        stored: what `read_stored` gave.
        protocol: how.
        models: folder of model points, where ADD and ADD-S are measured.
        point_stride: measure them with every n-th point, instead of what `stored` says; the fewer
            the points, the larger ADD-S and the lower its AUC.
        align_first: right-multiply every track so that its first pose is the truth, as is done
            for model-free trackers.

    Raises:
        InputError: detections under a protocol of tracks, no models.
        DataError: a model is missing.
    """
    if stored.images:
        scores = _score_images(stored.images, protocol)
    else:
        records = align_first_frame(stored.records) if align_first else stored.records
        if protocol.needs_models:
            stride = stored.point_stride if point_stride is None else point_stride
            scores = _score_points(records, protocol, models, stride)
        else:
            scores = protocol.score(records)
    notes = (*scores.notes, *stored.remarks)
    details = scores.details | {"data_kind": stored.kind}
    return replace(scores, data=stored.data, tracker=stored.tracker, notes=notes, details=details)


def _score_points(
    records: Sequence[PoseRecord], protocol: Protocol, models: Path | None, stride: int
) -> Scores:
    """ADD and ADD-S and, since ADD-S depends on the points' density, both with every point and
    with every third one."""
    scores = protocol.score(records, _points(records, models, stride))
    beside = {
        key: protocol.score(records, _points(records, models, other)).mean
        for other, key in _POINT_ROWS.items()
        if stride in _POINT_ROWS and other != stride
    }
    details = scores.details | {"point_stride": stride} | beside
    return replace(_say_stride(scores, stride), details=details)


def _score_images(images: Sequence[Image], protocol: Protocol) -> Scores:
    if protocol.name == "nocs-map":
        return score_images(images)
    if protocol.name == "wild6d":
        return score_images(images, "wild6d", "aabb_fixed", handle_rule=False)
    raise InputError(f"detections cannot be scored by '{protocol.name}', only by nocs-map, wild6d")


def _points(
    records: Sequence[PoseRecord], models: Path | None, stride: int
) -> dict[str, np.ndarray]:
    if models is None:
        raise InputError("ADD and ADD-S need the objects' points: give --models")
    if stride < 1:
        raise InputError(f"the point stride must be at least 1, not {stride}")
    points = read_model_points(models, {record.category for record in records})
    return {name: rows[::stride] for name, rows in points.items()}


def _say_stride(scores: Scores, stride: int) -> Scores:
    if stride == 1:
        return scores
    note = (
        f"measured with each {stride}. model point: ADD-S is larger, its AUC lower, than with all"
    )
    return replace(scores, notes=(*scores.notes, note))


def default_models(path: Path, data: Path | None) -> Path | None:
    """`models_points/` or `models/` beside the stored poses or in the data set."""
    for root in (path.parent, data):
        for name in ("models_points", "models"):
            if root is not None and (root / name).is_dir():
                return root / name
    return None
