"""Write a recording in the layout that `read_video` and the field's tools read."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import repeat
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from robust6dof.data.depth_unit import metres_to_depth
from robust6dof.data.image_files import write_image
from robust6dof.errors import InputError
from robust6dof.frames import RgbdFrame


class SequenceWriter:
    """Writes frame by frame: `rgb/`, `depth/` (uint16 mm), `cam_K.txt`, `stamps.txt` and, where
    given, `masks/` and `annotated_poses/`.

    Args:
        path: the folder; made where it does not exist.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self.count = 0
        self._K: np.ndarray | None = None

    def add(
        self,
        frame: RgbdFrame,
        mask: Bool[np.ndarray, "H W"] | None = None,
        T_cam_obj: Float[np.ndarray, "4 4"] | None = None,
    ) -> None:
        """Append one frame, under its own name or, where it has none, its number.

        Raises:
            InputError: the intrinsics differ from those of the first frame.
            DataError: a file cannot be written.
        """
        name = frame.name or f"{self.count:06d}"
        self._write_intrinsics(frame.K)
        write_image(self._file("rgb", f"{name}.png"), frame.rgb)
        write_image(self._file("depth", f"{name}.png"), metres_to_depth(frame.depth))
        if mask is not None:
            write_image(self._file("masks", f"{name}.png"), mask.astype(np.uint8) * 255)
        if T_cam_obj is not None:
            np.savetxt(self._file("annotated_poses", f"{name}.txt"), T_cam_obj, fmt="%.9f")
        if frame.stamp is not None:
            mode = "a" if self.count else "w"
            with (self.path / "stamps.txt").open(mode) as stamps:
                stamps.write(f"{name} {frame.stamp!r}\n")
        self.count += 1

    def add_mask(self, frame_name: str, object_name: str, mask: Bool[np.ndarray, "H W"]) -> None:
        """Write the mask of one of several objects: `masks/<object>/<frame>.png`."""
        path = self.path / "masks" / object_name / f"{frame_name}.png"
        path.parent.mkdir(parents=True, exist_ok=True)
        write_image(path, mask.astype(np.uint8) * 255)

    def _write_intrinsics(self, K: np.ndarray) -> None:
        if self._K is None:
            self.path.mkdir(parents=True, exist_ok=True)
            np.savetxt(self.path / "cam_K.txt", K, fmt="%.9g")
            self._K = K
        elif not np.array_equal(self._K, K):
            raise InputError("all frames of a recording must have the same intrinsics")

    def _file(self, folder: str, name: str) -> Path:
        (self.path / folder).mkdir(exist_ok=True)
        return self.path / folder / name


def write_sequence(
    path: str | Path,
    frames: Iterable[RgbdFrame],
    masks: Iterable[np.ndarray | None] | None = None,
    annotated_poses: Iterable[np.ndarray | None] | None = None,
) -> int:
    """Write frames with their masks and `T_cam_obj`; returns how many. See `SequenceWriter`."""
    writer = SequenceWriter(path)
    nothing = repeat(None)
    for frame, mask, T_cam_obj in zip(
        frames, masks or nothing, annotated_poses or nothing, strict=False
    ):
        writer.add(frame, mask, T_cam_obj)
    return writer.count
