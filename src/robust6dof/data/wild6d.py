"""Wild6D: hand-held phone videos of five categories."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from jaxtyping import Float

from robust6dof.data.dataset import Dataset, DatasetSequence, ObjectTruth, absent, make_frame
from robust6dof.data.depth_unit import MILLIMETRE, depth_to_metres
from robust6dof.data.image_files import read_color, read_depth, read_mask, read_text
from robust6dof.data.layouts import natural_key
from robust6dof.data.restricted_pickle import read_pickle
from robust6dof.errors import DataError, InputError
from robust6dof.frames import CATEGORIES, RgbdFrame
from robust6dof.geometry.transforms import check_transform, make_transform


@dataclass(frozen=True, eq=False)
class Wild6dSequence(DatasetSequence):
    """One video of one object; its name is category/object/sequence."""

    name: str
    frame_names: tuple[str, ...]
    folder: Path
    annotation_file: Path

    @cached_property
    def K(self) -> Float[np.ndarray, "3 3"]:
        """Intrinsics from `metadata`, which stores them column by column.

        Raises:
            DataError: missing or malformed.
        """
        path = self.folder / "metadata"
        try:
            numbers = json.loads(read_text(path))["K"]
            return np.array(numbers, dtype=np.float64).reshape(3, 3).T
        except (ValueError, KeyError, TypeError) as error:
            raise DataError(
                path, f"no JSON with nine numbers K ({error})", "Get it again"
            ) from error

    def frame(self, index: int) -> RgbdFrame:
        name = self.frame_names[index]
        color = self.folder / "images" / f"{name}.jpg"
        depth = depth_to_metres(read_depth(self._image(name, "depth")), MILLIMETRE)
        return make_frame(read_color(color), depth, self.K, name, color)

    def truth(self, index: int) -> tuple[ObjectTruth, ...]:
        """The object; nothing past the end of the annotations or without a mask, as the
        official evaluation skips those frames."""
        name = self.frame_names[index]
        mask_file = self._image(name, "mask")
        if int(name) >= len(self._annotations) or not mask_file.is_file():
            return ()
        annotation = self._annotations[int(name)]
        try:
            T_cam_obj = check_transform(
                make_transform(
                    np.asarray(annotation["rotation"]), np.ravel(annotation["translation"])
                )
            )
            extents = np.asarray(annotation["size"], dtype=np.float64).reshape(3)
        except (InputError, KeyError, ValueError, TypeError) as error:
            raise DataError(
                self.annotation_file, f"annotation {name}: {error}", "Get it again"
            ) from error
        category, object_id, sequence = self.name.split("/")
        return (
            ObjectTruth(
                name=f"{category}-{object_id}-{sequence}",
                category=category,
                T_cam_obj=T_cam_obj,
                extents=extents,
                mask=read_mask(mask_file),
                handle_visible=True,
            ),
        )

    def missing(self, index: int) -> tuple[str, ...]:
        files: dict[str, Path | None] = {
            "-mask.png": self._image(self.frame_names[index], "mask"),
            "poses (pkl_annotations)": self.annotation_file,
        }
        return absent(files)

    @cached_property
    def _annotations(self) -> list[dict]:
        if not self.annotation_file.is_file():
            return []
        fields = read_pickle(self.annotation_file)
        if not isinstance(fields, dict) or "annotations" not in fields:
            raise DataError(self.annotation_file, "it lacks annotations", "Get it again")
        return list(fields["annotations"])

    def _image(self, name: str, kind: str) -> Path:
        return self.folder / "images" / f"{name}-{kind}.png"


def open_wild6d(path: str | Path) -> Dataset:
    """Open Wild6D's test set: `path` is `test_set` or the folder above it.

    Raises:
        DataError: no videos there.
    """
    path = Path(path)
    for root in (path / "test_set", path):
        videos = [
            _open_video(root, images.parent)
            for category in CATEGORIES
            for images in root.glob(f"{category}/*/*/images")
        ]
        found = [video for video in videos if video.frame_names]
        if found:
            found.sort(key=lambda video: natural_key(video.name))
            return Dataset("wild6d", path, tuple(found))
    raise DataError(path, "no videos of Wild6D", "Looked for test_set/<category>/*/*/images/*.jpg")


def _open_video(root: Path, folder: Path) -> Wild6dSequence:
    name = folder.relative_to(root).as_posix()
    category = name.split("/")[0]
    names = (file.stem for file in (folder / "images").glob("*.jpg") if file.stem.isdigit())
    return Wild6dSequence(
        name,
        tuple(sorted(names, key=int)),
        folder,
        root / "pkl_annotations" / category / f"{name.replace('/', '-')}.pkl",
    )
