"""Which data set a folder is: `open_dataset`."""

from __future__ import annotations

from pathlib import Path

from robust6dof.data.dataset import Dataset
from robust6dof.data.layouts import LOOKED_FOR, tsdf_folder
from robust6dof.data.nocs import open_nocs
from robust6dof.data.recordings import open_recordings
from robust6dof.data.wild6d import open_wild6d
from robust6dof.data.ycb_video import open_ycb_video, refuse_bop
from robust6dof.errors import DataError

_SIGNS = {
    "ycb-video": (
        *("*-meta.mat", "[0-9]*/*-meta.mat", "data/[0-9]*/*-color.png"),
        *("[0-9][0-9][0-9][0-9]/*-color.png", "*-color.png"),
    ),
    "wild6d": ("test_set/*/*/*/images", "[a-z]*/*/*/images"),
    "nocs": tuple(
        prefix + folder + "[0-9][0-9][0-9][0-9]_color.png"
        for prefix in ("", "data/")
        for folder in ("", "real_test/*/", "real_train/*/", "val/*/", "train/*/", "Real/*/*/")
    )
    + ("CAMERA/*/*/*_color.png", "data/CAMERA/*/*/*_color.png"),
}
"""Files that only the data set of that name has."""


def recognise(path: str | Path) -> str:
    """Name of the layout: recordings, ycb-video, wild6d or nocs.

    Raises:
        DataError: no such folder, none of these, or BOP's YCB-Video.
    """
    path = Path(path)
    if not path.is_dir():
        raise DataError(path, "no such folder", "Name the folder of a data set or a recording")
    refuse_bop(path)
    if (path / "rgb").is_dir() or (path / "depth").is_dir() or tsdf_folder(path) is not None:
        return "recordings"
    for name, patterns in _SIGNS.items():
        if any(next(iter(path.glob(pattern)), None) is not None for pattern in patterns):
            return name
    if next(iter(path.glob("**/cam_K.txt")), None) is not None:
        return "recordings"
    raise DataError(
        path,
        "neither a recording nor a data set that is known",
        f"Looked for {LOOKED_FOR}; NOCS (real_test/*/0000_color.png, …), YCB-Video "
        "(data/0000/000001-color.png), Wild6D (test_set/*/*/*/images)",
    )


def open_dataset(
    path: str | Path, depth_only: bool = False, models: str | Path | None = None
) -> Dataset:
    """Open whatever data set or recording a folder holds, with its default split.

    Args:
        path: the folder.
        depth_only: for recordings whose colour is not registered to their depth.
        models: for YCB-Video, where the object models lie if not in its `models/`.

    Raises:
        DataError: not recognised, or not readable.
    """
    name = recognise(path)
    if name == "recordings":
        return open_recordings(path, depth_only)
    if name == "ycb-video":
        return open_ycb_video(path, models=models)
    return open_nocs(path) if name == "nocs" else open_wild6d(path)
