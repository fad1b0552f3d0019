"""Trajectories and shapes of YCB-Video on disk, and which of its videos are rendered again."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from robust6dof.data.ycb_video import TEST_VIDEOS
from robust6dof.errors import DataError, InputError
from robust6dof.shapes.loading import load_mesh
from robust6dof.shapes.mesh import Material, TexturedMesh
from robust6dof.shapes.ycb_objects import find_ycb_scan


@dataclass(frozen=True)
class YcbVideoPlan:
    """All that determines one re-rendered video."""

    video: str
    objects: tuple[str, ...]
    frames: tuple[int, ...]
    """Numbers of the frames in the real video, counted from 1."""
    seed: int


@dataclass(frozen=True, eq=False)
class YcbSource:
    """Where trajectories and shapes come from; see docs/evaluation.md for the files."""

    poses: Path
    """Folder with ycbv_gt_poses_by_video.npz, ycbv_to_google16k_frame.json and models_points/."""
    meshes: Path
    """Folder of the scans (google_16k); see `find_ycb_scan`."""

    def trajectories(self) -> dict[str, dict[str, Float[np.ndarray, "F 7"]]]:
        """Video → object → one row `qw qx qy qz tx ty tz` for each frame."""
        path = self._file("ycbv_gt_poses_by_video.npz")
        videos: dict[str, dict[str, np.ndarray]] = {}
        with np.load(path) as arrays:
            for key in arrays.files:
                video, _, name = key.partition("/")
                if video.isdecimal() and int(video) in TEST_VIDEOS:
                    videos.setdefault(video, {})[name] = arrays[key].astype(np.float64)
        if not videos:
            raise DataError(path, "holds no test video (0048 to 0059)", "Get the file again")
        return videos

    def model_points(self, name: str) -> Path:
        """The official points of an object, in YCB-Video's object frame."""
        return self._file(f"models_points/{name}.xyz")

    def mesh(self, name: str) -> TexturedMesh:
        """The scan in YCB-Video's object frame [m]."""
        mesh = load_mesh(find_ycb_scan(self.meshes, name))
        frame = json.loads(self._file("ycbv_to_google16k_frame.json").read_text())[name]
        R = np.array(frame["R_ycbv_to_google16k"])
        t = np.array(frame["t_ycbv_to_google16k_m"])
        return replace(mesh, vertices=(mesh.vertices - t) @ R, material=Material(0.1, 20.0))

    def _file(self, name: str) -> Path:
        path = self.poses / name
        if not path.is_file():
            raise DataError(path, "the file is missing", "docs/evaluation.md says what is needed")
        return path


def plan_ycb_video(
    source: YcbSource,
    seed: int,
    videos: Sequence[str] = (),
    every: int = 1,
    frames: int | None = None,
) -> list[YcbVideoPlan]:
    """One plan for each test video.

    Args:
        source: of trajectories and shapes.
        seed: of light, table and sensor.
        videos: 0048 to 0059; all if empty.
        every: render each n-th frame of the real video.
        frames: at most so many of each.

    Raises:
        InputError: no such video, or numbers that leave nothing.
        DataError: a missing file.
    """
    there = source.trajectories()
    unknown = set(videos) - there.keys()
    if unknown or every < 1 or (frames is not None and frames < 1):
        raise InputError(
            f"--videos takes {', '.join(sorted(there))}; --every and --frames count from 1"
        )
    plans = []
    for video in sorted(videos or there):
        objects = tuple(sorted(there[video]))
        count = len(there[video][objects[0]])
        numbers = tuple(range(1, count + 1, every))[:frames]
        plans.append(YcbVideoPlan(video, objects, numbers, seed))
    return plans
