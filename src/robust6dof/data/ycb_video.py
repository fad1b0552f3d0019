"""YCB-Video as its authors publish it ("classic"); BOP's conversion of it is told apart."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

import numpy as np
import scipy.io
from jaxtyping import Float

from robust6dof.data.dataset import Dataset, DatasetSequence, ObjectTruth, absent, make_frame
from robust6dof.data.depth_unit import depth_to_metres
from robust6dof.data.image_files import read_color, read_depth, read_labels, read_numbers, read_text
from robust6dof.errors import DataError, InputError
from robust6dof.frames import YCB_OBJECTS, RgbdFrame
from robust6dof.geometry.transforms import check_transform, make_transform

YcbVideoSplit = Literal["all", "train", "test"]

TEST_VIDEOS = range(48, 60)
SECOND_CAMERA_FROM = 60
"""Videos from this one on were taken with another camera."""
K_FIRST = np.array([[1066.778, 0, 312.9869], [0, 1067.487, 241.3109], [0, 0, 1]])
K_SECOND = np.array([[1077.836, 0, 323.7872], [0, 1078.189, 279.6921], [0, 0, 1]])
DEPTH_FACTOR = 10000
"""Depth steps per metre where no meta.mat says it."""


@dataclass(frozen=True, eq=False)
class YcbVideoSequence(DatasetSequence):
    """One video; poses are in YCB-Video's own object frames."""

    name: str
    frame_names: tuple[str, ...]
    folder: Path
    models: Path | None
    """Folder of `<object>/points.xyz` or `<object>.xyz`, where there is one."""

    def frame(self, index: int) -> RgbdFrame:
        name = self.frame_names[index]
        color, meta = self._file(name, "color.png"), self._meta(name)
        factor = DEPTH_FACTOR if meta is None else float(np.ravel(meta["factor_depth"])[0])
        depth = depth_to_metres(read_depth(self._file(name, "depth.png")), 1.0 / factor)
        K = self._video_K() if meta is None else np.asarray(meta["intrinsic_matrix"], np.float64)
        return make_frame(read_color(color), depth, K, name, color)

    def truth(self, index: int) -> tuple[ObjectTruth, ...]:
        name = self.frame_names[index]
        meta = self._meta(name)
        if meta is None:
            return ()
        label_file = self._file(name, "label.png")
        labels = read_labels(label_file) if label_file.is_file() else None
        class_ids: list[int] = np.ravel(meta["cls_indexes"]).astype(int).tolist()
        # MATLAB drops the last dimension where there is a single object.
        poses = np.asarray(meta["poses"], np.float64).reshape(3, 4, -1)
        known = all(1 <= class_id <= len(YCB_OBJECTS) for class_id in class_ids)
        if poses.shape[2] != len(class_ids) or not known:
            raise self._meta_error(name, f"{poses.shape[2]} poses for classes {class_ids}")
        return tuple(
            self._truth(name, class_id, poses[..., i], labels)
            for i, class_id in enumerate(class_ids)
        )

    def missing(self, index: int) -> tuple[str, ...]:
        name = self.frame_names[index]
        files: dict[str, Path | None] = {
            "-meta.mat (poses, intrinsics)": self._file(name, "meta.mat"),
            "-label.png (masks)": self._file(name, "label.png"),
            "models/ (sizes, points)": self.models,
        }
        return absent(files)

    def _truth(
        self, name: str, class_id: int, Rt: Float[np.ndarray, "3 4"], labels: np.ndarray | None
    ) -> ObjectTruth:
        object_name = YCB_OBJECTS[class_id - 1]
        try:
            T_cam_obj = check_transform(make_transform(Rt[:, :3], Rt[:, 3]), object_name)
        except InputError as error:
            raise self._meta_error(name, str(error)) from error
        bounds = None if self.models is None else _model_bounds(self.models, object_name)
        return ObjectTruth(
            name=object_name,
            category=object_name,
            T_cam_obj=T_cam_obj,
            extents=None if bounds is None else bounds[1] - bounds[0],
            box_center=np.zeros(3) if bounds is None else bounds.mean(axis=0),
            mask=None if labels is None else labels == class_id,
            instance_id=class_id,
        )

    def _file(self, name: str, ending: str) -> Path:
        return self.folder / f"{name}-{ending}"

    def _meta(self, name: str) -> dict[str, Any] | None:
        path = self._file(name, "meta.mat")
        if not path.is_file():
            return None
        try:
            meta = scipy.io.loadmat(path)
        except Exception as error:  # scipy raises many kinds on a torn file
            raise self._meta_error(name, f"unreadable ({error})") from error
        missing = {"cls_indexes", "poses", "factor_depth", "intrinsic_matrix"} - meta.keys()
        if missing:
            raise self._meta_error(name, f"it lacks {', '.join(sorted(missing))}")
        return meta

    def _meta_error(self, name: str, problem: str) -> DataError:
        return DataError(self._file(name, "meta.mat"), problem, "Get the file again")

    def _video_K(self) -> Float[np.ndarray, "3 3"]:
        if not self.name.isdigit():
            raise DataError(
                self.folder,
                "no meta.mat tells the intrinsics, nor does the folder's name tell the video",
                "Rename the folder to its video's number (0000 to 0091), or add the meta.mat files",
            )
        return K_FIRST if int(self.name) < SECOND_CAMERA_FROM else K_SECOND


def open_ycb_video(
    path: str | Path, split: YcbVideoSplit = "all", models: str | Path | None = None
) -> Dataset:
    """Open YCB-Video: `path` holds `data/0000/…` or the videos themselves, or is one video.

    Args:
        path: the root.
        split: `test` is videos 0048 to 0059, `train` the others.
        models: folder with `<object>/points.xyz` or `<object>.xyz`, for the extents
            (default: `models/` of the root, where it is).

    Raises:
        DataError: BOP's conversion, whose object frames differ; or no such videos.
    """
    path = Path(path)
    refuse_bop(path)
    chosen = Path(models) if models else path / "models"
    models_folder = chosen if chosen.is_dir() else None
    wanted: dict[str, Callable[[str], bool]] = {
        "all": lambda _: True,
        "test": lambda name: int(name) in TEST_VIDEOS,
        "train": lambda name: int(name) not in TEST_VIDEOS,
    }
    sequences = [_open_video(folder, models_folder) for folder in _video_folders(path)]
    kept = tuple(s for s in sequences if s is not None and wanted[split](s.name))
    if not kept:
        raise DataError(
            path,
            f"no videos of YCB-Video ({split})",
            "Looked for data/0000/000001-color.png, 0000/000001-color.png, 000001-color.png",
        )
    return Dataset(f"ycb-video-{split}", path, kept)


def read_keyframes(path: str | Path) -> dict[str, tuple[str, ...]]:
    """Frame names of each video in `image_sets/keyframe.txt` (the file, or the root above it).

    Raises:
        DataError: missing or malformed.
    """
    path = Path(path)
    file = path / "image_sets" / "keyframe.txt" if path.is_dir() else path
    frames: dict[str, list[str]] = {}
    for line in read_text(file).split():
        if not re.fullmatch(r"\d{4}/\d{6}", line):
            raise DataError(file, f"'{line}' is no video/frame", "Get YCB-Video's image_sets")
        frames.setdefault(line[:4], []).append(line[5:])
    return {video: tuple(names) for video, names in frames.items()}


def _video_folders(path: Path) -> list[Path]:
    for root in (path / "data", path):
        folders = sorted(root.glob("[0-9][0-9][0-9][0-9]"))
        if folders:
            return folders
    return [path]


def _open_video(folder: Path, models: Path | None) -> YcbVideoSequence | None:
    names = sorted(file.name.removesuffix("-color.png") for file in folder.glob("*-color.png"))
    if not names:
        return None
    return YcbVideoSequence(folder.resolve().name, tuple(names), folder, models)


def refuse_bop(path: Path) -> None:
    """Tell BOP's conversion from the classic release.

    Raises:
        DataError: `path` is BOP's.
    """
    for pattern in ("scene_gt.json", "*/scene_gt.json", "*/*/scene_gt.json"):
        file = next(iter(path.glob(pattern)), None)
        if file is not None:
            raise DataError(
                file,
                "this is BOP's ycbv: millimetres, and object frames moved to other centres",
                "Get the classic YCB-Video; poses and models of the two must not be mixed",
            )


@lru_cache(maxsize=64)
def _model_bounds(models: Path, name: str) -> Float[np.ndarray, "2 3"] | None:
    """Lowest and highest corner of an object's points [m]; None where they are not there."""
    path = find_model_points(models, name)
    if path is None:
        return None
    points = read_numbers(path).reshape(-1, 3)
    return np.stack([points.min(axis=0), points.max(axis=0)])


def find_model_points(models: Path, name: str) -> Path | None:
    """`<object>/points.xyz` (YCB-Video's own) or `<object>.xyz`; None where there is neither."""
    files = (models / name / "points.xyz", models / f"{name}.xyz")
    return next((file for file in files if file.is_file()), None)
