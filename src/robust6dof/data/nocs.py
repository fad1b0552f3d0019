"""NOCS: CAMERA25 and REAL275, in the zips' own layout and in SPD's renamed one."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
from jaxtyping import Float, UInt8

from robust6dof.data.dataset import Dataset, DatasetSequence, ObjectTruth, absent, make_frame
from robust6dof.data.depth_unit import MILLIMETRE, depth_to_metres
from robust6dof.data.image_files import read_color, read_labels
from robust6dof.data.layouts import natural_key
from robust6dof.data.nocs_truth import MetaLine, NocsTruthFiles, read_meta
from robust6dof.errors import DataError
from robust6dof.frames import RgbdFrame

NocsSplit = Literal["camera_train", "camera_val", "real_train", "real_test"]

FOLDERS: dict[NocsSplit, tuple[str, ...]] = {
    "camera_train": ("train", "CAMERA/train"),
    "camera_val": ("val", "CAMERA/val"),
    "real_train": ("real_train", "Real/train"),
    "real_test": ("real_test", "Real/test"),
}
"""Where each split lies: in the zips' own layout, in SPD's."""

K_REAL = np.array([[591.0125, 0, 322.525], [0, 590.16775, 244.11084], [0, 0, 1]])
K_CAMERA = np.array([[577.5, 0, 319.5], [0, 577.5, 239.5], [0, 0, 1]])
INVALID_CAMERA_DEPTH = 32001
"""What CAMERA writes for "no depth"."""
BACKGROUND = 255


@dataclass(frozen=True, eq=False)
class NocsSequence(DatasetSequence):
    """One scene of REAL275, or one folder of ten single images of CAMERA25."""

    name: str
    frame_names: tuple[str, ...]
    folder: Path
    composed_folder: Path | None
    """CAMERA's depth with the background (camera_full_depths); None for REAL275."""
    files: NocsTruthFiles

    @property
    def K(self) -> Float[np.ndarray, "3 3"]:
        return K_REAL if self.composed_folder is None else K_CAMERA

    def frame(self, index: int) -> RgbdFrame:
        name = self.frame_names[index]
        color = self.folder / f"{name}_color.png"
        depth = depth_to_metres(self._depth_values(name), MILLIMETRE)
        return make_frame(read_color(color), depth, self.K, name, color)

    def truth(self, index: int) -> tuple[ObjectTruth, ...]:
        name = self.frame_names[index]
        meta = self.folder / f"{name}_meta.txt"
        if not meta.is_file():
            return ()
        return self.files.read(name, read_meta(meta), self.instance_ids(index))

    def missing(self, index: int) -> tuple[str, ...]:
        name = self.frame_names[index]
        endings = ("mask.png", "meta.txt", "coord.png")
        files: dict[str, Path | None] = {f"_{e}": self.folder / f"{name}_{e}" for e in endings}
        return absent(files) + self.files.missing(name)

    def meta(self, index: int) -> tuple[MetaLine, ...]:
        """The lines of `_meta.txt`, distractors and absent objects included."""
        return read_meta(self.folder / f"{self.frame_names[index]}_meta.txt")

    def instance_ids(self, index: int) -> UInt8[np.ndarray, "H W"]:
        """Instance id of every pixel; 255 is background."""
        labels = read_labels(self.folder / f"{self.frame_names[index]}_mask.png")
        return (labels if labels.ndim == 2 else labels[..., 0]).astype(np.uint8)

    def coordinates(self, index: int) -> Float[np.ndarray, "H W 3"]:
        """NOCS coordinates of every pixel, 0 to 1, with z flipped as the poses need it.

        Only pixels on objects mean anything.
        """
        coordinates = read_color(self.folder / f"{self.frame_names[index]}_coord.png") / 255.0
        coordinates[..., 2] = 1.0 - coordinates[..., 2]
        return coordinates

    def _depth_values(self, name: str) -> np.ndarray:
        path = self.folder / f"{name}_depth.png"
        if self.composed_folder is not None:
            path = self.composed_folder / f"{name}_composed.png"
            if not path.is_file():
                raise DataError(
                    path,
                    "CAMERA's depth with the background is missing",
                    "Unpack camera_full_depths.zip beside the images",
                )
        return decode_depth(read_labels(path))


def decode_depth(image: np.ndarray) -> np.ndarray:
    """Millimetres [H, W] from NOCS's two encodings: uint16, or G·256 + R of three channels."""
    if image.ndim == 2:
        return image.astype(np.uint16)
    values = image[..., 1].astype(np.uint16) * 256 + image[..., 0]
    values[values == INVALID_CAMERA_DEPTH] = 0
    return values


def open_nocs(path: str | Path, split: NocsSplit | None = None) -> Dataset:
    """Open a split of NOCS, in either layout; `path` may be SPD's `data/` or the folder above.

    The truth comes from the official `gts` pickles where they are, else from SPD's `_label.pkl`.
    The two differ for mugs: SPD moved their origin to the cup's axis.

    Args:
        path: the root, or one scene's folder (which then has no truth unless labels lie in it).
        split: which part; when not given, the first of real_test, camera_val, real_train,
            camera_train that is there.

    Raises:
        DataError: no such split.
    """
    path = Path(path)
    order: tuple[NocsSplit, ...] = ("real_test", "camera_val", "real_train", "camera_train")
    for candidate in (split,) if split else order:
        for root in (path, path / "data"):
            for folder in FOLDERS[candidate]:
                sequences = _open_split(root, root / folder, candidate)
                if sequences:
                    return Dataset(f"nocs-{candidate}", path, sequences)
    scene = _open_scene(path, path, split or "real_test")
    if scene is not None:
        return Dataset(f"nocs-{split or 'real_test'}", path, (scene,))
    raise DataError(
        path,
        f"no NOCS images of {split or 'any split'}",
        "Looked for " + ", ".join(f"{folder}/*/0000_color.png" for folder in _folders(split)),
    )


def _folders(split: NocsSplit | None) -> list[str]:
    return [f for name, folders in FOLDERS.items() if split in (None, name) for f in folders]


def _open_split(root: Path, folder: Path, split: NocsSplit) -> tuple[DatasetSequence, ...]:
    if not folder.is_dir():
        return ()
    scenes = sorted(folder.iterdir(), key=lambda scene: natural_key(scene.name))
    opened = (_open_scene(root, scene, split) for scene in scenes if scene.is_dir())
    return tuple(sequence for sequence in opened if sequence is not None)


def _open_scene(root: Path, folder: Path, split: NocsSplit) -> NocsSequence | None:
    colors = folder.glob("*_color.png") if folder.is_dir() else ()
    stems = (file.name.removesuffix("_color.png") for file in colors)
    names = sorted((stem for stem in stems if stem.isdigit()), key=natural_key)
    if not names:
        return None
    composed = None
    if split.startswith("camera"):
        part = split.removeprefix("camera_")
        composed = root / "camera_full_depths" / part / folder.name
    files = NocsTruthFiles(root, folder, split)
    return NocsSequence(folder.name, tuple(names), folder, composed, files)
