"""Tracks on disk: `track.jsonl`, one object and frame a line, and `ob_in_cam/*.txt`."""

from __future__ import annotations

import json
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from jaxtyping import Float

from robust6dof.data.image_files import read_transform
from robust6dof.data.layouts import files_by_stem
from robust6dof.errors import DataError, InputError, Robust6dofWarning
from robust6dof.frames import Track, TrackState
from robust6dof.geometry.transforms import check_transform


@dataclass(frozen=True, eq=False)
class TrackRow:
    """One line of `track.jsonl`."""

    frame: str
    """The frame's name in its recording."""
    track: Track
    """The pose; its memory and stamp are not stored."""
    ms: float
    """Time the step took [ms]."""


class TrackWriter:
    """Writes `track.jsonl` line by line; every line is on disk before the next step.

    Args:
        path: the file; its folder is made.
        resume: keep the whole lines that are there and go on after them.
    """

    def __init__(self, path: str | Path, resume: bool = False) -> None:
        self.path = Path(path)
        self.path.parent.mkdir(parents=True, exist_ok=True)
        if resume and self.path.exists():
            _drop_torn_line(self.path)
        self._file = self.path.open("a" if resume else "w", encoding="utf-8")

    def write(self, frame: str, track: Track, ms: float) -> None:
        """Append one line.

        Raises:
            InputError: a NaN in the track.
        """
        try:
            line = json.dumps(_to_json(TrackRow(frame, track, ms)), allow_nan=False)
        except ValueError as error:
            raise InputError(f"the track of frame {frame} contains NaN or infinity") from error
        self._file.write(line + "\n")
        self._file.flush()

    def close(self) -> None:
        self._file.close()

    def __enter__(self) -> TrackWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()


def read_tracks(path: str | Path) -> Iterator[TrackRow]:
    """Read `track.jsonl` line by line. A torn last line (a killed run) is left out with a warning.

    Raises:
        DataError: missing, or a line that is not a track.
    """
    path = Path(path)
    if not path.is_file():
        raise DataError(path, "the file is missing", "Run robust6dof track first")
    with path.open(encoding="utf-8") as lines:
        for number, line in enumerate(lines, start=1):
            if not line.endswith("\n"):
                warnings.warn(
                    f"{path}: the last line is torn and left out", Robust6dofWarning, stacklevel=2
                )
                return
            yield _parse_line(path, number, line)


def _parse_line(path: Path, number: int, line: str) -> TrackRow:
    try:
        return _from_json(json.loads(line))
    except (ValueError, KeyError, TypeError, InputError) as error:
        raise DataError(
            path,
            f"line {number} is not a track ({type(error).__name__}: {error})",
            "Remove it, or run robust6dof track again",
        ) from error


def _to_json(row: TrackRow) -> dict[str, Any]:
    track = row.track
    return {
        "frame": row.frame,
        "object": track.object_name,
        "category": track.category,
        "T_cam_obj": np.asarray(track.T_cam_obj, dtype=np.float64).ravel().tolist(),
        "extents_m": np.asarray(track.extents, dtype=np.float64).tolist(),
        "confidence": float(track.confidence),
        "state": str(track.state),
        "ms": round(float(row.ms), 3),
    }


def _from_json(fields: dict[str, Any]) -> TrackRow:
    track = Track(
        T_cam_obj=check_transform(np.array(fields["T_cam_obj"], dtype=np.float64).reshape(4, 4)),
        extents=np.array(fields["extents_m"], dtype=np.float64).reshape(3),
        confidence=float(fields["confidence"]),
        state=TrackState(fields["state"]),
        category=str(fields["category"]),
        object_name=str(fields["object"]),
    )
    return TrackRow(str(fields["frame"]), track, float(fields["ms"]))


def _drop_torn_line(path: Path) -> None:
    content = path.read_bytes()
    whole = content.rfind(b"\n") + 1
    if whole < len(content):
        with path.open("r+b") as file:
            file.truncate(whole)


def write_ob_in_cam(folder: str | Path, frame: str, T_cam_obj: Float[np.ndarray, "4 4"]) -> None:
    """Write one pose as `<folder>/<frame>.txt` (4×4, metres), as the field's tools do."""
    Path(folder).mkdir(parents=True, exist_ok=True)
    np.savetxt(Path(folder) / f"{frame}.txt", T_cam_obj, fmt="%.9f")


def read_ob_in_cam(folder: str | Path) -> dict[str, np.ndarray]:
    """Read every pose of an `ob_in_cam` folder, by frame name, in natural order.

    Raises:
        DataError: no poses there, or one that is not a rigid transform.
    """
    files = files_by_stem(Path(folder), [".txt"])
    if not files:
        raise DataError(folder, "there are no poses", "Name the folder with the frames' .txt files")
    return {frame: read_transform(path) for frame, path in files.items()}
