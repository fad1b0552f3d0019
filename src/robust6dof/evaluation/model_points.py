"""The object models that ADD and ADD-S measure with."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from robust6dof.data.ycb_video import find_model_points
from robust6dof.errors import DataError


def read_model_points(folder: str | Path, objects: Iterable[str]) -> dict[str, np.ndarray]:
    """The points of each object, [P, 3] in m, from the file that `find_model_points` finds.

    Raises:
        DataError: a model is missing, is no list of points, or is not in metres.
    """
    return {name: _read_points(_find(Path(folder), name)) for name in sorted(set(objects))}


def _find(folder: Path, name: str) -> Path:
    path = find_model_points(folder, name)
    if path is None:
        raise DataError(
            folder,
            f"there are no model points of {name}",
            f"Name a folder with {name}.xyz or {name}/points.xyz by --models",
        )
    return path


def _read_points(path: Path) -> np.ndarray:
    try:
        points = np.loadtxt(path, dtype=np.float64, ndmin=2)
    except ValueError as error:
        raise DataError(path, f"not a list of points ({error})", "Get the file again") from error
    if points.size == 0 or points.shape[1] < 3 or not np.isfinite(points).all():
        raise DataError(path, "not a list of x y z points", "Get the file again")
    size = float(np.ptp(points[:, :3], axis=0).max())
    if size > 5.0:
        raise DataError(
            path,
            f"the model is {size:.4g} m long, so it is in millimetres",
            "BOP's models are; they also have another object frame. Use YCB-Video's own points",
        )
    return points[:, :3]
