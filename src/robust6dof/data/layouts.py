"""Which files of a folder make which frame: the two layouts of one's own RGB-D recording."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from robust6dof.errors import DataError, Robust6dofWarning

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg")

LOOKED_FOR = (
    "rgb/ + depth/ + cam_K.txt, or frame-*.color.jpg|png + frame-*.depth.png + "
    "camera-intrinsics.txt (in the folder or in its data/)"
)


@dataclass(frozen=True)
class FrameFiles:
    """The files of one frame; None where the recording has none."""

    name: str
    color: Path | None
    depth: Path
    mask: Path | None = None
    annotated_pose: Path | None = None
    camera_pose: Path | None = None


@dataclass(frozen=True)
class Recording:
    """A folder understood: its frames in order and the file of its intrinsics."""

    layout: str
    """`folders` (the field's de-facto layout) or `tsdf-fusion` (7-Scenes)."""
    path: Path
    intrinsics: Path
    frames: tuple[FrameFiles, ...]


def find_recording(path: Path, depth_only: bool = False) -> Recording:
    """Recognise the layout of a folder and pair its files by name.

    Args:
        path: the recording.
        depth_only: colour is not needed, so that its absence is no error.

    Raises:
        DataError: no such folder, an unknown layout, no frames, colour without depth.
    """
    if not path.is_dir():
        problem = "not a folder" if path.exists() else "no such folder"
        raise DataError(path, problem, f"A recording is a folder with {LOOKED_FOR}")
    if (path / "rgb").is_dir() or (path / "depth").is_dir():
        recording = _find_folders(path, depth_only)
    elif tsdf_folder(path) is not None:
        recording = _find_tsdf_fusion(path, depth_only)
    else:
        raise DataError(path, "no layout is recognised", f"Looked for {LOOKED_FOR}")
    if not recording.frames:
        raise DataError(path, "there are no frames", f"Looked for {LOOKED_FOR}")
    return recording


def natural_key(name: str) -> list[tuple[int, str]]:
    """Sort key under which frame_10 comes after frame_9."""
    parts = re.split(r"(\d+)", name)
    return [(int(part), "") if part.isdigit() else (-1, part) for part in parts]


def files_by_stem(folder: Path, suffixes: Iterable[str] = IMAGE_SUFFIXES) -> dict[str, Path]:
    """Files with one of the suffixes, by stem, in natural order; empty where there is no folder."""
    if not folder.is_dir():
        return {}
    wanted = tuple(suffixes)
    paths = [path for path in folder.iterdir() if path.suffix.lower() in wanted]
    paths = [path for path in paths if not path.name.startswith(".")]
    return {path.stem: path for path in sorted(paths, key=lambda path: natural_key(path.stem))}


def _find_folders(path: Path, depth_only: bool) -> Recording:
    colors, depths = files_by_stem(path / "rgb"), files_by_stem(path / "depth", [".png"])
    masks = files_by_stem(path / "masks")
    names = _paired(path, colors, depths, depth_only)
    poses = _annotated_poses(path / "annotated_poses", names)
    frames = tuple(
        FrameFiles(name, colors.get(name), depths[name], masks.get(name), poses.get(name))
        for name in names
    )
    return Recording("folders", path, path / "cam_K.txt", frames)


def _annotated_poses(folder: Path, names: list[str]) -> dict[str, Path]:
    """Pair by name; where no name fits (YCBInEOAT numbers its poses), by order as its tools do."""
    files = files_by_stem(folder, [".txt"])
    if not (files and names and files.keys().isdisjoint(names)):
        return files
    if len(files) != len(names):
        raise DataError(
            folder,
            f"{len(files)} poses for {len(names)} frames, and no name in common",
            "Name the poses as the frames, or remove the folder",
        )
    return dict(zip(names, files.values(), strict=True))


def tsdf_folder(path: Path) -> Path | None:
    """The folder that holds the 7-Scenes frames: `path` or its `data/`."""
    for folder in (path, path / "data"):
        if any(folder.glob("*.depth.png")) or any(folder.glob("*.color.*")):
            return folder
    return None


def _find_tsdf_fusion(path: Path, depth_only: bool) -> Recording:
    folder = tsdf_folder(path) or path
    colors = _with_ending(folder, ".color")
    depths, camera_poses = _with_ending(folder, ".depth"), _with_ending(folder, ".pose", [".txt"])
    frames = tuple(
        FrameFiles(name, colors.get(name), depths[name], camera_pose=camera_poses.get(name))
        for name in _paired(path, colors, depths, depth_only)
    )
    candidates = [place / "camera-intrinsics.txt" for place in (path, folder, path.parent)]
    intrinsics = next((file for file in candidates if file.is_file()), candidates[0])
    return Recording("tsdf-fusion", path, intrinsics, frames)


def _with_ending(
    folder: Path, ending: str, suffixes: Iterable[str] = IMAGE_SUFFIXES
) -> dict[str, Path]:
    files = files_by_stem(folder, suffixes)
    return {stem.removesuffix(ending): p for stem, p in files.items() if stem.endswith(ending)}


def _paired(
    path: Path, colors: dict[str, Path], depths: dict[str, Path], depth_only: bool
) -> list[str]:
    if depth_only:
        return list(depths)
    without_depth = [name for name in colors if name not in depths]
    if without_depth:
        raise DataError(
            colors[without_depth[0]],
            f"{len(without_depth)} of {len(colors)} colour frames have no depth image of that name",
            "Restore the depth images, or remove these frames",
        )
    without_color = len(depths) - len(colors)
    if without_color and not colors:
        raise DataError(path, "there is depth but no colour", "Restore it, or pass depth_only=True")
    if without_color:
        warnings.warn(
            f"{path}: {without_color} depth images without colour are ignored",
            Robust6dofWarning,
            stacklevel=2,
        )
    return list(colors)
