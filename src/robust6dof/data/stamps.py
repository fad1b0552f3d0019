"""Time stamps of a recording's frames."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from robust6dof.data.image_files import read_text
from robust6dof.errors import DataError, InputError

_REMEDY = "Write one time in seconds a line, in frame order, or the frame's name and its time"


def frame_stamps(path: Path, names: list[str], fps: float | None) -> tuple[float | None, ...]:
    """Times [s] of the frames: from `fps`, else from the folder's `stamps.txt`, else None.

    Raises:
        InputError: `fps` is not positive.
        DataError: `stamps.txt` lacks a frame, is not numbers, or does not increase.
    """
    if fps is not None:
        if not fps > 0:
            raise InputError(f"fps must be positive, got {fps}")
        return tuple(index / fps for index in range(len(names)))
    file = path / "stamps.txt"
    return _read_stamps(file, names) if file.is_file() else (None,) * len(names)


def _read_stamps(file: Path, names: list[str]) -> tuple[float, ...]:
    rows = [line.split() for line in read_text(file).splitlines() if line.strip()]
    try:
        if all(len(row) == 2 for row in rows):
            by_name = {name: float(stamp) for name, stamp in rows}
            stamps = [by_name[name] for name in names]
        else:
            stamps = [float(stamp) for (stamp,) in rows]
    except KeyError as error:
        raise DataError(file, f"no time for frame {error}", _REMEDY) from error
    except ValueError as error:
        raise DataError(file, f"not a list of times ({error})", _REMEDY) from error
    if len(stamps) != len(names):
        raise DataError(file, f"{len(stamps)} times for {len(names)} frames", _REMEDY)
    if not (np.diff(stamps) > 0).all():
        raise DataError(file, "the times do not increase", _REMEDY)
    return tuple(stamps)
