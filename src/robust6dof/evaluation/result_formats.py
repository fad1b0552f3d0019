"""The formats in which other people store poses: read to score them, written so that their
evaluators can score ours.

| format | files | pose |
|---|---|---|
| `nocs` | `results_*.pkl`, one an image, truth included | [sR | t], metres |
| `6pack` | `temp_<class>/<model>_<scene>_<n>_pose.txt` | R, t in mm, camera x and y flipped |
| `ob_in_cam` | `<sequence>[/<object>][/ob_in_cam]/<frame>.txt` | 4×4, metres |
| `bop` | one csv | R, t in mm, of the model centred on its box |
"""

from __future__ import annotations

import csv
import pickle
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from robust6dof.data.dataset import DatasetSequence, ObjectTruth
from robust6dof.data.image_files import read_transform
from robust6dof.data.restricted_pickle import read_pickle
from robust6dof.data.track_file import write_ob_in_cam
from robust6dof.errors import DataError, InputError
from robust6dof.evaluation.detections import Boxes, Image, images_from_records
from robust6dof.evaluation.records import PoseRecord
from robust6dof.evaluation.run_records import Predicted, object_pose
from robust6dof.frames import CATEGORIES, YCB_OBJECTS
from robust6dof.geometry.transforms import check_transform, make_transform

_FLIP = np.diag([-1.0, -1.0, 1.0, 1.0])
"""6-PACK's camera: x left, y up."""
_BOP_HEAD = ["scene_id", "im_id", "obj_id", "score", "R", "t", "time"]


def read_nocs_results(folder: str | Path) -> list[Image]:
    """Read every `results_*.pkl` of a folder: predictions and truths of one image each.

    Raises:
        DataError: none there, or one that is refused or incomplete.
    """
    paths = sorted(Path(folder).glob("**/results_*.pkl"))
    if not paths:
        raise DataError(folder, "there are no results_*.pkl", "Name the folder that holds them")
    return [_nocs_image(path) for path in paths]


def _nocs_image(path: Path) -> Image:
    fields = read_pickle(path)
    try:
        visible = fields.get("gt_handle_visibility")
        count = len(fields["gt_class_ids"])
        return Image(
            path.stem.removeprefix("results_"),
            _nocs_boxes(
                fields, "pred", np.ones(len(fields["pred_class_ids"])), fields["pred_scores"]
            ),
            _nocs_boxes(
                fields, "gt", np.ones(count) if visible is None else visible, np.ones(count)
            ),
            PurePosixPath(str(fields.get("image_path", ""))).parent.name,
        )
    except (KeyError, TypeError, ValueError, IndexError, AttributeError) as error:
        raise DataError(
            path,
            f"not a NOCS result ({type(error).__name__}: {error})",
            "It needs pred_ and gt_ class_ids, RTs and scales, and pred_scores",
        ) from error


def _nocs_boxes(fields: dict[str, Any], side: str, visible: Any, score: Any) -> Boxes:
    class_ids = np.asarray(fields[f"{side}_class_ids"], int).ravel()
    RTs = np.array(fields[f"{side}_RTs"], float).reshape(len(class_ids), 4, 4)
    sizes = np.array(fields[f"{side}_scales"], float).reshape(len(class_ids), 3)
    # A failed fit is stored as zeros or NaN: it stays a false positive, of a box without volume.
    failed = ~np.isfinite(RTs).all(axis=(1, 2))
    RTs[failed] = 0.0
    scale = np.cbrt(np.linalg.det(RTs[:, :3, :3]))
    failed |= scale < 1e-9
    RTs[failed], sizes[failed], scale[failed] = np.eye(4), 0.0, 1.0
    RTs[:, :3, :3] /= scale[:, None, None]
    return Boxes(
        [CATEGORIES[class_id - 1] for class_id in class_ids],
        RTs,
        sizes * scale[:, None],
        np.asarray(score, float).ravel(),
        np.asarray(visible).ravel() > 0,
    )


def write_nocs_results(folder: str | Path, records: Sequence[PoseRecord]) -> None:
    """One `results_<sequence>_<frame>.pkl` an image, as NOCS and SPD evaluate.

    Image boxes are not known here: every one is written as the whole image, since those
    evaluators only drop boxes of zeros.
    """
    Path(folder).mkdir(parents=True, exist_ok=True)
    names = {(r.sequence, r.frame): r.frame_name or f"{r.frame:04d}" for r in records}
    for image, (sequence, frame) in zip(images_from_records(records), names, strict=True):
        stem = f"results_{sequence.replace('/', '_')}_{names[sequence, frame]}"
        predicted, true = image.predicted, image.true
        fields = {
            "image_path": f"{sequence}/{names[sequence, frame]}",
            **_nocs_fields(predicted, "pred"),
            **_nocs_fields(true, "gt"),
            "pred_scores": predicted.score,
            "gt_handle_visibility": true.handle_visible.astype(int),
        }
        with (Path(folder) / f"{stem}.pkl").open("wb") as file:
            pickle.dump(fields, file)


def _nocs_fields(boxes: Boxes, side: str) -> dict[str, np.ndarray]:
    scale = np.linalg.norm(boxes.extents, axis=1)
    RTs = boxes.T_cam_obj.copy()
    RTs[:, :3, :3] *= scale[:, None, None]
    class_ids = [CATEGORIES.index(name) + 1 for name in boxes.category]
    return {
        f"{side}_class_ids": np.array(class_ids, np.int32),
        f"{side}_RTs": RTs,
        f"{side}_scales": boxes.extents / scale[:, None],
        f"{side}_bboxes": np.tile(np.array([0, 0, 479, 639]), (len(scale), 1)),
    }


class SixPackText:
    """6-PACK's pose files; n counts a model's annotated frames over all scenes in order."""

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)
        self._count: Counter[str] = Counter()
        if not any(self.folder.glob("temp_*")):
            raise DataError(folder, "there is no temp_<class> folder", "Name eval_results/TEST_n")

    def __call__(
        self, sequence: DatasetSequence, index: int, truth: ObjectTruth
    ) -> Predicted | None:
        name = _six_pack_name(truth.category, truth.name, sequence.name, self._count[truth.name])
        self._count[truth.name] += 1
        path = self.folder / name
        if not path.is_file():
            return None
        try:
            rows = np.array([line.split()[:3] for line in path.read_text().splitlines()[:4]], float)
            flipped = make_transform(rows[:3], rows[3] / 1000)
            return Predicted(check_transform(_FLIP @ flipped), truth.extents)
        except (ValueError, IndexError, InputError) as error:
            raise DataError(path, f"not a 6-PACK pose ({error})", "Get it again") from error


def write_six_pack(folder: str | Path, records: Sequence[PoseRecord]) -> None:
    """Write what benchmark.py reads: three rows of R, then t in millimetres."""
    count: Counter[str] = Counter()
    for record in records:
        name = _six_pack_name(record.category, record.object, record.sequence, count[record.object])
        count[record.object] += 1
        if record.T_cam_obj is not None:
            flipped = _FLIP @ record.T_cam_obj
            path = Path(folder) / name
            path.parent.mkdir(parents=True, exist_ok=True)
            np.savetxt(path, np.vstack([flipped[:3, :3], 1000 * flipped[:3, 3]]), fmt="%.9f")


def _six_pack_name(category: str, model: str, scene: str, number: int) -> str:
    class_id = _class_id(category)
    return f"temp_{class_id}/{model}_{scene.replace('/', '_')}_{number}_pose.txt"


class ObInCam:
    """A folder of 4×4 text files for each video, as BundleTrack and FoundationPose write them."""

    def __init__(self, folder: str | Path) -> None:
        self.folder = Path(folder)

    def __call__(
        self, sequence: DatasetSequence, index: int, truth: ObjectTruth
    ) -> Predicted | None:
        for place in (f"{sequence.name}/{truth.name}", sequence.name, "."):
            for inner in ("ob_in_cam", "."):
                path = self.folder / place / inner / f"{sequence.frame_names[index]}.txt"
                if path.is_file():
                    return Predicted(read_transform(path), truth.extents)
        return None


def write_ob_in_cam_folders(folder: str | Path, records: Iterable[PoseRecord]) -> None:
    """Write `<sequence>/<object>/ob_in_cam/<frame>.txt`."""
    for record in records:
        if record.T_cam_obj is not None:
            place = Path(folder) / record.sequence / record.object / "ob_in_cam"
            write_ob_in_cam(place, record.frame_name or f"{record.frame:06d}", record.T_cam_obj)


class BopCsv:
    """A BOP result file. BOP centres each model on its box, so its pose is that of the box.

    Only for data whose extents are known: without them a YCB-Video model's centre is not.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self._best: dict[tuple[int, int, int], tuple[float, np.ndarray]] = {}
        with self.path.open(newline="") as file:
            for number, row in enumerate(csv.reader(file), start=1):
                if row and row[0].strip() != "scene_id":
                    self._add(number, row)

    def _add(self, number: int, row: list[str]) -> None:
        try:
            key = (int(row[0]), int(row[1]), int(row[2]))
            R_cam_box = np.array(row[4].split(), float).reshape(3, 3)
            t_cam_box = np.array(row[5].split(), float).reshape(3) / 1000
            T_cam_box = check_transform(make_transform(R_cam_box, t_cam_box))
            score = float(row[3])
        except (ValueError, IndexError, InputError) as error:
            raise DataError(
                self.path, f"line {number} is no BOP result ({error})", ",".join(_BOP_HEAD)
            ) from error
        if key not in self._best or score > self._best[key][0]:
            self._best[key] = (score, T_cam_box)

    def __call__(
        self, sequence: DatasetSequence, index: int, truth: ObjectTruth
    ) -> Predicted | None:
        if truth.extents is None:
            raise DataError(
                self.path,
                f"BOP's frame of {truth.name} is centred on its box, whose centre is unknown",
                "Put the models beside the data (models/<object>/points.xyz)",
            )
        frame = _number(sequence.frame_names[index])
        found = self._best.get((_number(sequence.name), frame, _class_id(truth.category)))
        if found is None:
            return None
        return Predicted(object_pose(found[1], truth), truth.extents, found[0])


def write_bop_csv(path: str | Path, records: Iterable[PoseRecord]) -> None:
    """Write BOP's result file; the time is not known here and written as −1."""
    Path(path).parent.mkdir(parents=True, exist_ok=True)
    with Path(path).open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(_BOP_HEAD)
        for record in records:
            if record.T_cam_obj is None:
                continue
            R = record.T_cam_obj[:3, :3]
            t_mm = 1000 * (record.T_cam_obj[:3, 3] + R @ record.box_center)
            numbers = (_number(record.sequence), _number(record.frame_name or str(record.frame)))
            writer.writerow(
                [
                    *numbers,
                    _class_id(record.category),
                    f"{record.confidence:.6f}",
                    _text(R),
                    _text(t_mm),
                    -1,
                ]
            )


def export_records(form: str, folder: Path, records: Sequence[PoseRecord]) -> None:
    """Write records in one of the four formats.

    Raises:
        InputError: there are none (detections are not assigned to objects), or names without the
            numbers that the format needs.
    """
    if not records:
        raise InputError("there are no tracks to export")
    if form == "bop":
        write_bop_csv(folder / "results.csv", records)
        return
    writers = {"nocs": write_nocs_results, "6pack": write_six_pack}
    writers.get(form, write_ob_in_cam_folders)(folder, records)


def _text(values: np.ndarray) -> str:
    return " ".join(f"{value:.9g}" for value in values.ravel())


def _number(name: str) -> int:
    digits = "".join(character for character in name if character.isdigit())
    if not digits:
        raise InputError(f"BOP numbers its scenes and images, but '{name}' has no number")
    return int(digits)


def _class_id(category: str) -> int:
    """The data set's own class number: NOCS 1 to 6, YCB-Video 1 to 21."""
    for names in (CATEGORIES, YCB_OBJECTS):
        if category in names:
            return names.index(category) + 1
    raise InputError(f"'{category}' has no class number in NOCS or YCB-Video")
