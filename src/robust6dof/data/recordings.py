"""Recordings in the de-facto layout as a data set: YCBInEOAT, one's own, synthesised ones."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from robust6dof.data.dataset import Dataset, DatasetSequence, ObjectTruth, absent
from robust6dof.data.layouts import natural_key
from robust6dof.data.video import Video, read_video
from robust6dof.errors import DataError
from robust6dof.frames import RgbdFrame

YCBINEOAT_OBJECTS = {
    "bleach0": "021_bleach_cleanser",
    "bleach_hard_00_03_chaitanya": "021_bleach_cleanser",
    "cracker_box_reorient": "003_cracker_box",
    "cracker_box_yalehand0": "003_cracker_box",
    "mustard0": "006_mustard_bottle",
    "mustard_easy_00_02": "006_mustard_bottle",
    "sugar_box1": "004_sugar_box",
    "sugar_box_yalehand0": "004_sugar_box",
    "tomato_soup_can_yalehand0": "005_tomato_soup_can",
}
"""Which YCB object each of YCBInEOAT's videos shows."""


UNNAMED = "object_0"


@dataclass(frozen=True, eq=False)
class RecordingSequence(DatasetSequence):
    """One recording with one annotated object."""

    name: str
    frame_names: tuple[str, ...]
    video: Video
    object_name: str
    """YCBInEOAT's object, which is its category too; else `object_0` of category `unknown`."""

    def frame(self, index: int) -> RgbdFrame:
        return self.video[index]

    def truth(self, index: int) -> tuple[ObjectTruth, ...]:
        T_cam_obj = self.video.annotated_pose(index)
        if T_cam_obj is None:
            return ()
        category = "unknown" if self.object_name == UNNAMED else self.object_name
        mask = self.video.mask(index)
        return (ObjectTruth(self.object_name, category, T_cam_obj, mask=mask),)

    def missing(self, index: int) -> tuple[str, ...]:
        files = self.video.files[index]
        stamped = self.video.stamps[index] is not None
        optional: dict[str, Path | None] = {
            "masks/": files.mask,
            "annotated_poses/": files.annotated_pose,
            "stamps.txt": self.video.path if stamped else None,
        }
        return absent(optional)


def open_recordings(path: str | Path, depth_only: bool = False) -> Dataset:
    """Open one recording, or every recording in a folder, however deep.

    What each shows is told by YCBInEOAT's names of its videos, else it is `object_0` of category
    `unknown`, without a size. Several objects and sizes need `ground_truth.jsonl`
    (`robust6dof.data.truth_file`).

    Raises:
        DataError: no recordings there, or one that `read_video` refuses.
    """
    path = Path(path)
    folders = sorted(
        {found.parent for found in path.glob("**/cam_K.txt")},
        key=lambda folder: natural_key(str(folder)),
    )
    sequences = tuple(_open_recording(path, folder, depth_only) for folder in folders or [path])
    if not sequences:
        raise DataError(path, "there are no recordings", "Looked for folders with cam_K.txt")
    return Dataset(_dataset_name(sequences), path, sequences)


def _open_recording(root: Path, folder: Path, depth_only: bool) -> RecordingSequence:
    video = read_video(folder, depth_only=depth_only)
    relative = folder.relative_to(root).as_posix()
    name = folder.resolve().name if relative == "." else relative
    object_name = YCBINEOAT_OBJECTS.get(folder.resolve().name, UNNAMED)
    return RecordingSequence(name, video.names, video, object_name)


def _dataset_name(sequences: tuple[RecordingSequence, ...]) -> str:
    names = {Path(sequence.name).name for sequence in sequences}
    return "ycbineoat" if names <= YCBINEOAT_OBJECTS.keys() else "recordings"
