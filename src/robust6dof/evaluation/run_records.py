"""Second loop, first half: a stored run and its data set make the records that are scored."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from robust6dof.data.dataset import Dataset, DatasetSequence, ObjectTruth
from robust6dof.data.track_file import read_tracks
from robust6dof.data.truth_file import AnnotatedTruth
from robust6dof.data.ycb_video import read_keyframes
from robust6dof.errors import DataError
from robust6dof.evaluation.records import PoseRecord
from robust6dof.evaluation.run_info import RunInfo
from robust6dof.frames import Track, TrackState

_FEW = 3
"""Names that a remark lists, at most."""


@dataclass(frozen=True, eq=False)
class Predicted:
    """A stored pose, in the object frame of the data set."""

    T_cam_obj: Float[np.ndarray, "4 4"]
    extents: Float[np.ndarray, "3"] | None = None
    confidence: float = 1.0
    state: TrackState = TrackState.TRACKING


Prediction = Callable[[DatasetSequence, int, ObjectTruth], Predicted | None]
"""(sequence, frame index, truth) → what is stored for that object, or None."""


def read_run_info(run: Path) -> RunInfo:
    """What made a run.

    Raises:
        DataError: the folder holds none.
    """
    path = run / "run.json"
    try:
        return RunInfo(**json.loads(path.read_text()))
    except FileNotFoundError as error:
        raise DataError(path, "no run is stored here", "Run robust6dof predict first") from error
    except (ValueError, TypeError) as error:
        raise DataError(path, f"unreadable ({error})", "Run robust6dof predict again") from error


def gaps_of_run(run: Path, sequences: Sequence[str]) -> tuple[str, ...]:
    """What a run lacks of these sequences, in words: all of it counts as missing poses."""
    gaps = []
    unfinished = [name for name in sequences if not (run / name / "done.json").is_file()]
    if unfinished:
        gaps.append(
            f"{len(unfinished)} of {len(sequences)} sequences are not finished in this run, and "
            f"what they lack counts as missing: {_first_of(unfinished)}"
        )
    failed = [
        f"{name}/{key} ({why})"
        for name in sequences
        if name not in unfinished
        for key, why in json.loads((run / name / "done.json").read_text())["failed"].items()
    ]
    if failed:
        gaps.append(f"{len(failed)} objects were not started everywhere: {_first_of(failed)}")
    return tuple(gaps)


def _first_of(names: Sequence[str]) -> str:
    return ", ".join(names[:_FEW]) + (", …" if len(names) > _FEW else "")


def records_of_run(run: Path, dataset: Dataset, keyframes_only: bool = False) -> list[PoseRecord]:
    """One record per annotated frame and object; what the run lacks is missing, not left out.

    Raises:
        DataError: the run holds no track of this data set.
    """
    records = list(make_records(dataset, RunTracks(run), keyframes_only))
    if not any(record.T_cam_obj is not None for record in records):
        raise DataError(run, "no track of this data set is stored", "Check --data, or predict")
    return records


def make_records(
    dataset: Dataset, prediction: Prediction, keyframes_only: bool = False
) -> Iterator[PoseRecord]:
    """The truth of every frame and object beside its prediction, in the data set's order.

    Args:
        dataset: where the truth is.
        prediction: gives each stored pose.
        keyframes_only: leave out what `image_sets/keyframe.txt` (YCB-Video) does not list, where
            the data set has that file.
    """
    has_list = (dataset.path / "image_sets" / "keyframe.txt").is_file()
    keyframes = read_keyframes(dataset.path) if keyframes_only and has_list else None
    for sequence in dataset.sequences:
        for index in range(len(sequence)):
            listed = None if keyframes is None else keyframes.get(sequence.name, ())
            if listed is not None and sequence.frame_names[index] not in listed:
                continue
            for truth in sequence.truth(index):
                yield _record(sequence, index, truth, prediction(sequence, index, truth))


def _record(
    sequence: DatasetSequence, index: int, truth: ObjectTruth, predicted: Predicted | None
) -> PoseRecord:
    annotated = truth if isinstance(truth, AnnotatedTruth) else None
    return PoseRecord(
        sequence=sequence.name,
        frame=index,
        object=truth.name,
        category=truth.category,
        T_cam_obj_true=truth.T_cam_obj,
        extents_true=np.full(3, np.nan) if truth.extents is None else truth.extents,
        box_center=truth.box_center,
        T_cam_obj=None if predicted is None else predicted.T_cam_obj,
        extents=None if predicted is None else predicted.extents,
        confidence=0.0 if predicted is None else predicted.confidence,
        state=TrackState.LOST if predicted is None else predicted.state,
        stamp=None if annotated is None else annotated.stamp,
        visibility=1.0 if truth.visible_fraction is None else truth.visible_fraction,
        symmetric=annotated is not None and annotated.symmetric,
        handle_visible=truth.handle_visible,
        difficulty="" if annotated is None else annotated.difficulty,
        frame_name=sequence.frame_names[index],
    )


def object_pose(T_cam_box: np.ndarray, truth: ObjectTruth) -> Float[np.ndarray, "4 4"]:
    """From the pose of an object's box to that of the data set's object frame."""
    T_cam_obj = T_cam_box.copy()
    T_cam_obj[:3, 3] -= T_cam_box[:3, :3] @ truth.box_center
    return T_cam_obj


class RunTracks:
    """The tracks of a run, read one sequence at a time."""

    def __init__(self, run: Path) -> None:
        self.run = run
        self._sequence = ""
        self._tracks: dict[str, dict[str, Track]] = {}

    def __call__(
        self, sequence: DatasetSequence, index: int, truth: ObjectTruth
    ) -> Predicted | None:
        if sequence.name != self._sequence:
            self._sequence, self._tracks = sequence.name, {}
        if truth.name not in self._tracks:
            self._tracks[truth.name] = self._read(sequence.name, truth.name)
        track = self._tracks[truth.name].get(sequence.frame_names[index])
        if track is None:
            return None
        T_cam_obj = object_pose(track.T_cam_obj, truth)
        return Predicted(T_cam_obj, track.extents, track.confidence, track.state)

    def _read(self, sequence: str, name: str) -> dict[str, Track]:
        path = self.run / sequence / name / "track.jsonl"
        return {row.frame: row.track for row in read_tracks(path)} if path.is_file() else {}
