"""`ground_truth.jsonl`: the truth of a recording with one or several objects (docs/evaluation.md).

One line per frame and object: `frame` (name), `stamp` [s], `object`, `category`, `T_cam_obj` (16
numbers, row by row, metres), `extents_m`, `visibility` (0–1), `handle_visible`, `symmetric`; where
they apply `box_center_m` (not zero only for models that are not centred) and `difficulty`.
Masks lie in `masks/<object>/<frame>.png`, or in `masks/<frame>.png` where there is one object.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from robust6dof.data.dataset import Dataset, DatasetSequence, ObjectTruth
from robust6dof.data.image_files import read_mask
from robust6dof.data.recognition import open_dataset
from robust6dof.data.recordings import RecordingSequence
from robust6dof.errors import DataError, InputError
from robust6dof.frames import RgbdFrame
from robust6dof.geometry.transforms import check_transform

FILE_NAME = "ground_truth.jsonl"


@dataclass(frozen=True, eq=False)
class AnnotatedTruth(ObjectTruth):
    """One line of `ground_truth.jsonl`."""

    frame: str = ""
    stamp: float | None = None
    symmetric: bool = False
    """Turning the object about its y axis changes nothing."""
    difficulty: str = ""


@dataclass(frozen=True, eq=False)
class TruthFileSequence(DatasetSequence):
    """A recording whose truth stands in its `ground_truth.jsonl`."""

    recording: RecordingSequence
    name: str
    frame_names: tuple[str, ...]
    truths: dict[str, list[AnnotatedTruth]]
    """Frame name → its objects, without masks."""
    with_masks: bool = True

    def frame(self, index: int) -> RgbdFrame:
        return self.recording.frame(index)

    def truth(self, index: int) -> tuple[ObjectTruth, ...]:
        name = self.frame_names[index]
        truths = self.truths.get(name, [])
        if not self.with_masks:
            return tuple(truths)
        return tuple(replace(truth, mask=self._mask(truth.name, name)) for truth in truths)

    def missing(self, index: int) -> tuple[str, ...]:
        return ()

    def _mask(self, object_name: str, frame: str) -> np.ndarray | None:
        masks = self.recording.video.path / "masks"
        path = masks / object_name / f"{frame}.png"
        if not path.is_file() and len(self.truths[frame]) == 1:
            path = masks / f"{frame}.png"
        return read_mask(path) if path.is_file() else None


def open_with_truth(path: str | Path, with_masks: bool = True) -> Dataset:
    """Open a data set or recordings; `ground_truth.jsonl` goes before any other annotation.

    Args:
        path: whatever `open_dataset` knows.
        with_masks: read the masks of recordings with that file.

    Raises:
        DataError: not recognised, or not readable.
    """
    dataset = open_dataset(path)
    sequences = tuple(_with_truth_file(sequence, with_masks) for sequence in dataset.sequences)
    return replace(dataset, sequences=sequences)


def _with_truth_file(sequence: DatasetSequence, with_masks: bool) -> DatasetSequence:
    if not isinstance(sequence, RecordingSequence):
        return sequence
    path = sequence.video.path / FILE_NAME
    if not path.is_file():
        return sequence
    truths: dict[str, list[AnnotatedTruth]] = {}
    for truth in read_truth_file(path):
        truths.setdefault(truth.frame, []).append(truth)
    return TruthFileSequence(sequence, sequence.name, sequence.frame_names, truths, with_masks)


def read_truth_file(path: str | Path) -> list[AnnotatedTruth]:
    """Read every line.

    Raises:
        DataError: missing, or a line that is not a truth.
    """
    path = Path(path)
    if not path.is_file():
        raise DataError(path, "the file is missing", "Synthesise or annotate the recording again")
    truths: list[AnnotatedTruth] = []
    for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), start=1):
        try:
            truths.append(_from_json(json.loads(line)))
        except (ValueError, KeyError, TypeError, InputError) as error:
            raise DataError(
                path,
                f"line {number} is not a truth ({type(error).__name__}: {error})",
                "docs/evaluation.md gives its fields",
            ) from error
    return truths


def write_truth_file(path: str | Path, truths: Iterable[AnnotatedTruth]) -> None:
    """Write one line per frame and object; masks are not part of it."""
    lines = [json.dumps(_to_json(truth), allow_nan=False) + "\n" for truth in truths]
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    Path(path).write_text("".join(lines), encoding="utf-8")


def _to_json(truth: AnnotatedTruth) -> dict[str, Any]:
    return {
        "frame": truth.frame,
        "stamp": truth.stamp,
        "object": truth.name,
        "category": truth.category,
        "T_cam_obj": np.asarray(truth.T_cam_obj, float).ravel().tolist(),
        "extents_m": None if truth.extents is None else np.asarray(truth.extents, float).tolist(),
        "visibility": 1.0 if truth.visible_fraction is None else float(truth.visible_fraction),
        "handle_visible": bool(truth.handle_visible),
        "symmetric": bool(truth.symmetric),
        **({"difficulty": truth.difficulty} if truth.difficulty else {}),
        **({"box_center_m": truth.box_center.tolist()} if truth.box_center.any() else {}),
    }


def _from_json(fields: dict[str, Any]) -> AnnotatedTruth:
    extents = fields["extents_m"]
    visibility = float(fields["visibility"])
    if not 0.0 <= visibility <= 1.0:
        raise ValueError(f"visibility {visibility} is not between 0 and 1")
    return AnnotatedTruth(
        name=str(fields["object"]),
        category=str(fields["category"]),
        T_cam_obj=check_transform(np.array(fields["T_cam_obj"], float).reshape(4, 4)),
        extents=None if extents is None else np.array(extents, float).reshape(3),
        box_center=np.array(fields.get("box_center_m", [0, 0, 0]), float).reshape(3),
        handle_visible=bool(fields["handle_visible"]),
        visible_fraction=visibility,
        frame=str(fields["frame"]),
        stamp=fields.get("stamp"),
        symmetric=bool(fields["symmetric"]),
        difficulty=str(fields.get("difficulty", "")),
    )
