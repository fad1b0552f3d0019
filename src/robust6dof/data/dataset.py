"""What every data set gives: sequences of frames, and the truth about each object in them."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from robust6dof.errors import DataError, InputError
from robust6dof.frames import RgbdFrame


@dataclass(frozen=True, eq=False)
class ObjectTruth:
    """The ground truth about one object in one frame."""

    name: str
    """The object's name in its sequence."""
    category: str
    """NOCS category, or the object's own name where the data set has instances only."""
    T_cam_obj: Float[np.ndarray, "4 4"]
    """Rigid (the scale of NOCS is stripped), metres, in the data set's own object frame."""
    extents: Float[np.ndarray, "3"] | None = None
    """Side lengths of the box along the object's axes [m], where the data set has them."""
    box_center: Float[np.ndarray, "3"] = field(default_factory=lambda: np.zeros(3))
    """Centre of the box in the object frame [m]; not zero for YCB models."""
    mask: Bool[np.ndarray, "H W"] | None = None
    """Visible pixels, where the data set has them."""
    handle_visible: bool = True
    """Whether a mug's handle can be seen; while it cannot, the mug is symmetric."""
    visible_fraction: float | None = None
    """Share of the silhouette in view, 0 to 1, where the data set has it."""
    instance_id: int = 0
    """The data set's own number of the object in this frame."""

    @property
    def T_cam_box(self) -> Float[np.ndarray, "4 4"]:
        """Pose of the box: the object frame moved to the box's centre."""
        T_cam_box = self.T_cam_obj.copy()
        T_cam_box[:3, 3] += self.T_cam_obj[:3, :3] @ self.box_center
        return T_cam_box


class DatasetSequence(ABC):
    """Frames of one video, read when asked for; `truth` needs no colour or depth image."""

    name: str
    """Its name in the data set, such as scene_1 or 0048."""
    frame_names: tuple[str, ...]
    """The data set's own names of the frames, in order."""

    def __len__(self) -> int:
        return len(self.frame_names)

    @abstractmethod
    def frame(self, index: int) -> RgbdFrame:
        """Read one frame.

        Raises:
            DataError: a missing, truncated or unfitting file.
        """

    @abstractmethod
    def truth(self, index: int) -> tuple[ObjectTruth, ...]:
        """The objects annotated in one frame; empty where it has no annotation.

        Raises:
            DataError: an annotation that contradicts itself.
        """

    @abstractmethod
    def missing(self, index: int) -> tuple[str, ...]:
        """What the data set's layout foresees for a frame and this copy lacks, in words."""


@dataclass(frozen=True, eq=False)
class Dataset:
    """A data set on disk."""

    name: str
    """Which one, with its split: nocs-real_test, ycb-video, …"""
    path: Path
    sequences: tuple[DatasetSequence, ...]

    def sequence(self, name: str) -> DatasetSequence:
        """The sequence of that name.

        Raises:
            InputError: there is none.
        """
        for sequence in self.sequences:
            if sequence.name == name:
                return sequence
        known = ", ".join(sequence.name for sequence in self.sequences)
        raise InputError(f"{self.name} has no sequence '{name}'; it has: {known}")

    def only(self, names: Collection[str]) -> Dataset:
        """The data set with the sequences of these names alone; all of it if there are none.

        Raises:
            InputError: there is no such sequence.
        """
        if not names:
            return self
        return replace(self, sequences=tuple(self.sequence(name) for name in names))


def absent(files: dict[str, Path | None]) -> tuple[str, ...]:
    """Of what the paths are for, by name: those that do not exist."""
    return tuple(name for name, path in files.items() if path is None or not path.exists())


def make_frame(
    rgb: np.ndarray, depth: np.ndarray, K: np.ndarray, name: str, source: Path
) -> RgbdFrame:
    """Put a frame together; what does not fit is blamed on `source`.

    Raises:
        DataError: arrays of different sizes, or intrinsics of another image size.
    """
    try:
        return RgbdFrame(rgb, depth, K, name=name)
    except InputError as error:
        raise DataError(
            source, str(error), "Get the data set again, or report its layout"
        ) from error
