"""Folders that are no recordings but that the package knows: meshes, model points, pose packs,
robots."""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from xml.etree import ElementTree

import cv2
import numpy as np

from robust6dof.data.image_files import read_numbers
from robust6dof.data.restricted_pickle import read_npy
from robust6dof.data.ycb_video import read_keyframes
from robust6dof.errors import DataError
from robust6dof.shapes.loading import load_mesh, mesh_files

_FEW = 6
"""Meshes that are opened, at most."""


def other_contents(path: Path) -> Iterator[tuple[bool, str]]:
    """What is there and whether it makes sense: (sound, sentence), one for each kind of contents.

    Nothing where there is nothing that this package reads.
    """
    judges = (_trajectories, _pose_packs, _model_points, _keyframes, _robots, _meshes, _arrays)
    for judge in judges:
        try:
            yield from judge(path)
        except DataError as error:
            yield False, str(error)


def _trajectories(path: Path) -> Iterator[tuple[bool, str]]:
    for file in sorted(path.glob("*_poses_by_video.npz")):
        arrays = _read_npz(file)
        if not arrays:
            continue
        videos = {key.split("/")[0] for key in arrays}
        rows = np.concatenate(list(arrays.values()))
        far = float(np.abs(rows[:, 4:]).max())
        unit = float(np.abs(np.linalg.norm(rows[:, :4], axis=1) - 1).max())
        text = (
            f"{file.name}: {len(rows):,} poses of YCB-Video in {len(videos)} videos, up to "
            f"{far:.2f} m away (robust6dof synthesize ycb-video)"
        )
        yield far < 10 and unit < 1e-3, text


def _pose_packs(path: Path) -> Iterator[tuple[bool, str]]:
    for file in sorted(path.glob("*.zip")):
        if not zipfile.is_zipfile(file):
            yield False, f"{file.name} is not a zip file"
            continue
        with zipfile.ZipFile(file) as pack:
            parts = [Path(name).parts for name in pack.namelist() if name.endswith(".txt")]
        methods = sorted({part[-2] for part in parts if len(part) > 1})
        if "ground_truth" in methods:
            others = ", ".join(name for name in methods if name != "ground_truth")
            yield True, f"{file.name}: stored poses of {others} (robust6dof evaluate)"


def _model_points(path: Path) -> Iterator[tuple[bool, str]]:
    files = [*sorted(path.glob("*.xyz")), *sorted(path.glob("*/*.xyz"))]
    if files:
        boxes = [np.ptp(read_numbers(file).reshape(-1, 3), axis=0) for file in files]
        text = f"{len(files)} lists of model points, {_sizes(boxes)} (--models of evaluate)"
        yield float(np.max(boxes)) < 5, text


def _keyframes(path: Path) -> Iterator[tuple[bool, str]]:
    if (path / "image_sets" / "keyframe.txt").is_file():
        frames = read_keyframes(path)
        count = sum(map(len, frames.values()))
        yield True, f"{count:,} keyframes of {len(frames)} videos in image_sets/keyframe.txt"


def _robots(path: Path) -> Iterator[tuple[bool, str]]:
    for file in _robot_files(path):
        root = ElementTree.parse(file).getroot()
        bodies = list(root.iter("body"))
        # Joints elsewhere are defaults and couplings.
        joints = [part for body in bodies for part in body if part.tag in ("joint", "freejoint")]
        if bodies:
            text = f"a MuJoCo model of {len(bodies)} bodies and {len(joints)} joints"
            yield True, f"{file.name}: {text}"


def _robot_files(folder: Path) -> list[Path]:
    """MuJoCo's models in the folder and its subfolders; they say the unit of their meshes."""
    files = [*sorted(folder.glob("*.xml")), *sorted(folder.glob("*/*.xml"))]
    return [file for file in files if _root_tag(file) == "mujoco"]


def _root_tag(file: Path) -> str:
    try:
        return ElementTree.parse(file).getroot().tag
    except ElementTree.ParseError:
        return ""


def _meshes(path: Path) -> Iterator[tuple[bool, str]]:
    robots = {file.parent for file in _robot_files(path)}
    folders = [child for child in sorted(path.iterdir()) if child.is_dir()]
    files = [
        file
        for folder in [path, *folders]
        for file in _own_meshes(folder, folder == path)
        if not robots.intersection(file.parents)
    ]
    if not files:
        return
    boxes, wrong = [], []
    for file in files[:_FEW]:
        try:
            boxes.append(np.ptp(load_mesh(file).vertices, axis=0))
        except DataError as error:
            wrong.append(str(error))
    more = "" if len(files) <= _FEW else f", of which {_FEW} were opened"
    readable = f", {_sizes(boxes)}" if boxes else ""
    yield not wrong, f"{len(files)} meshes{more}{readable} (--meshes of synthesize and priors)"
    for text in wrong:
        yield False, text


def _own_meshes(folder: Path, is_root: bool) -> list[Path]:
    """In the folder and, below the root, in its subfolders."""
    found = mesh_files(folder)
    return [file for file in found if file.parent == folder] if is_root else found


def _sizes(boxes: Sequence[np.ndarray]) -> str:
    """Of side lengths [3]; clouds and meshes of a diagonal about 1 are in NOCS' units."""
    diagonals = np.linalg.norm(boxes, axis=1)
    if ((diagonals > 0.8) & (diagonals < 1.05)).all():
        return f"normalised: diagonals {diagonals.min():.2f} to {diagonals.max():.2f}"
    sides = np.max(boxes, axis=1)
    return f"largest sides {sides.min():.2f} to {sides.max():.2f} m"


def _arrays(path: Path) -> Iterator[tuple[bool, str]]:
    """What NumPy's files hold: arrays [… N 3] of points, and single RGB-D frames."""
    distances = []
    for file in [*sorted(path.glob("**/*.npz")), *sorted(path.glob("**/*.npy"))]:
        try:
            arrays = list(_read_npz(file).values()) if file.suffix == ".npz" else _read_npy(file)
        except DataError as error:
            yield False, str(error)
            continue
        clouds = [cloud for array in arrays for cloud in _points_of(array)]
        if clouds:
            boxes = [np.ptp(cloud, axis=0) for cloud in clouds]
            text = f"{file.name}: {len(clouds)} clouds of {len(clouds[0]):,} points"
            yield float(np.max(boxes)) < 5, f"{text}, {_sizes(boxes)}"
        distances += [distance for array in arrays for distance in _frame_distance(array)]
    if distances:
        yield (
            min(distances) > 0.1 and max(distances) < 10,
            f"{len(distances)} single frames in .npy files (image, depth, intrinsics_matrix), in "
            f"the median {min(distances):.2f} to {max(distances):.2f} m away: to track in them, "
            "write them into rgb/ and depth/ beside cam_K.txt",
        )


def _read_npz(file: Path) -> dict[str, np.ndarray]:
    """By name; empty where an array is pickled.

    Raises:
        DataError: truncated or damaged.
    """
    try:
        with np.load(file, allow_pickle=False) as arrays:
            return {key: arrays[key] for key in arrays.files}
    except (zipfile.BadZipFile, zlib.error, EOFError) as error:
        raise DataError(file, f"truncated or damaged ({error})", "Get it again") from error
    except (ValueError, OSError):
        return {}


def _read_npy(file: Path) -> list[np.ndarray]:
    """None where the file holds anything but arrays and builtin containers."""
    try:
        return [read_npy(file)]
    except DataError:
        return []


def _points_of(array: np.ndarray) -> list[np.ndarray]:
    pickled = array.dtype.hasobject
    if pickled or array.ndim < 2 or array.shape[-1] != 3 or array.shape[-2] < 100:
        return []
    return list(array.reshape(-1, *array.shape[-2:]))


def _frame_distance(array: np.ndarray) -> list[float]:
    """Median depth [m] of a frame as 6-DoF GraspNet stores it: image, depth in metres and K."""
    frame = array.item() if array.shape == () else None
    if not isinstance(frame, dict) or not {"image", "depth", "intrinsics_matrix"} <= frame.keys():
        return []
    depth = np.asarray(frame["depth"], float)
    return [float(np.median(depth[depth > 0])) if (depth > 0).any() else 0.0]


def loose_images(path: Path) -> str:
    """What colour and depth images there are; empty where there is no depth image among them."""
    images = [_image_kind(file) for file in sorted(path.glob("**/*.png"))]
    depths = [one for one in images if one.dtype == np.uint16 and one.ndim == 2]
    if not depths:
        return ""
    colours = sum(one.dtype == np.uint8 and one.ndim == 3 for one in images)
    middle = [float(np.median(one[one > 0])) / 1000 for one in depths if one.any()]
    seen = f", {min(middle):.2f} to {max(middle):.2f} m away if in millimetres" if middle else ""
    return (
        f"{len(depths)} depth and {colours} colour images{seen}: to track in them, put them into "
        "rgb/ and depth/ beside cam_K.txt"
    )


def _image_kind(file: Path) -> np.ndarray:
    image = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
    return np.zeros(0) if image is None else image
