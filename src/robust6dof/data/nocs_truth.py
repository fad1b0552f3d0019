"""Ground truth of NOCS: official pickles, SPD's labels, sizes and handle visibility."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, UInt8

from robust6dof.data.dataset import ObjectTruth
from robust6dof.data.image_files import read_numbers, read_text
from robust6dof.data.restricted_pickle import read_pickle
from robust6dof.errors import DataError, InputError
from robust6dof.frames import CATEGORIES
from robust6dof.geometry.transforms import check_transform

FAULTY_MUG = "b9be7cfe653740eb7633a2dd89cec754"
"""A CAMERA mug whose model is wrong; everybody leaves it out."""
BOX_TOLERANCE_PX = 5
"""Sum of differences up to which two image boxes are the same object (SPD's)."""


@dataclass(frozen=True)
class MetaLine:
    """One line of `_meta.txt`."""

    instance_id: int
    class_id: int
    """0 for a distractor, else 1 + the index into CATEGORIES."""
    model: str
    """REAL275: the scan's name; CAMERA25: the ShapeNet id."""


def read_meta(path: Path) -> tuple[MetaLine, ...]:
    """Read `_meta.txt`: instance id, class id, model (CAMERA: synset, model).

    Raises:
        DataError: missing or malformed.
    """
    try:
        rows = [line.split() for line in read_text(path).splitlines() if line.strip()]
        return tuple(MetaLine(int(row[0]), int(row[1]), row[-1]) for row in rows)
    except (ValueError, IndexError) as error:
        raise DataError(path, f"not a NOCS meta file ({error})", "Get it again") from error


@dataclass(frozen=True)
class NocsTruthFiles:
    """Finds and reads the truth about the frames of one scene."""

    root: Path
    folder: Path
    split: str

    def read(
        self, frame: str, meta: tuple[MetaLine, ...], instance_ids: UInt8[np.ndarray, "H W"]
    ) -> tuple[ObjectTruth, ...]:
        """The annotated objects in view, by ascending instance id.

        Raises:
            DataError: pickles that are unreadable or do not fit the mask.
        """
        present = _present(meta, instance_ids)
        label = self.folder / f"{frame}_label.pkl"
        if self._gts(frame).is_file():
            truths = self._from_gts(frame, present, instance_ids)
        elif label.is_file():
            truths = self._from_label(label, present, instance_ids)
        else:
            return ()
        return tuple(truth for truth in truths if truth.name != FAULTY_MUG)

    def missing(self, frame: str) -> tuple[str, ...]:
        """Which truth of one frame is not there, in words."""
        label = self.folder / f"{frame}_label.pkl"
        if not self._gts(frame).is_file() and not label.is_file():
            return (f"poses ({self._gts(frame).relative_to(self.root)} or {label.name})",)
        sizes = self.root / "obj_models" / self.split
        if self.split == "real_test" and not label.is_file() and not sizes.is_dir():
            return (f"sizes (obj_models/{self.split}/*.txt)",)
        return ()

    def _gts(self, frame: str) -> Path:
        part = self.split.removeprefix("camera_")
        return self.root / "gts" / part / f"results_{part}_{self.folder.name}_{frame}.pkl"

    def _from_gts(
        self, frame: str, present: list[MetaLine], instance_ids: np.ndarray
    ) -> list[ObjectTruth]:
        path = self._gts(frame)
        fields = _fields(path, "gt_RTs")
        RTs = np.asarray(fields["gt_RTs"], dtype=np.float64).reshape(-1, 4, 4)
        without_mug = [line for line in present if line.model != FAULTY_MUG]
        if len(RTs) == len(without_mug):
            present = without_mug
        if len(RTs) != len(present):
            raise DataError(
                path,
                f"{len(RTs)} poses for {len(present)} objects in the mask of {frame}",
                "Take gts, masks and meta files from the same release",
            )
        masks = [instance_ids == line.instance_id for line in present]
        handles = self._handles(frame, fields, present, masks)
        scales = fields.get("gt_scales")
        return [
            self._truth(path, line, RTs[i], masks[i], handles[i], _row(scales, i))
            for i, line in enumerate(present)
        ]

    def _from_label(
        self, path: Path, present: list[MetaLine], instance_ids: np.ndarray
    ) -> list[ObjectTruth]:
        """SPD's labels name their instances, in whatever order."""
        fields = _fields(path, "instance_ids", "rotations", "translations", "scales")
        order = {int(identity): i for i, identity in enumerate(fields["instance_ids"])}
        truths = []
        for line in present:
            if line.instance_id not in order:
                continue
            i = order[line.instance_id]
            RT = np.eye(4)
            RT[:3, :3] = float(fields["scales"][i]) * np.asarray(fields["rotations"][i])
            RT[:3, 3] = fields["translations"][i]
            handle = bool(np.asarray(fields.get("handle_visibility", np.ones(i + 1)))[i])
            mask = instance_ids == line.instance_id
            truths.append(self._truth(path, line, RT, mask, handle, _row(fields.get("size"), i)))
        return truths

    def _truth(
        self,
        path: Path,
        line: MetaLine,
        RT: Float[np.ndarray, "4 4"],
        mask: np.ndarray,
        handle_visible: bool,
        nocs_extents: Float[np.ndarray, "3"] | None,
    ) -> ObjectTruth:
        scale = np.cbrt(np.linalg.det(RT[:3, :3]))
        try:
            T_cam_obj = check_transform(np.vstack([np.c_[RT[:3, :3] / scale, RT[:3, 3]], RT[3:]]))
        except InputError as error:
            raise DataError(path, f"{line.model}: {error}", "Get it again") from error
        extents = self._metric_extents(line.model) if nocs_extents is None else scale * nocs_extents
        return ObjectTruth(
            name=line.model,
            category=CATEGORIES[line.class_id - 1],
            T_cam_obj=T_cam_obj,
            extents=extents,
            mask=mask,
            handle_visible=handle_visible,
            instance_id=line.instance_id,
        )

    def _metric_extents(self, model: str) -> Float[np.ndarray, "3"] | None:
        """REAL275's measured sizes: `obj_models/<split>/<model>.txt`, in metres."""
        for name in (model, f"{model}_norm"):
            path = self.root / "obj_models" / self.split / f"{name}.txt"
            if path.is_file():
                return read_numbers(path)[:3]
        return None

    def _handles(
        self, frame: str, fields: dict[str, Any], present: list[MetaLine], masks: list[np.ndarray]
    ) -> list[bool]:
        """`handle_visibility` of the pickle itself, else of SPD's stored results, else visible."""
        if "handle_visibility" in fields:
            return [bool(visible) for visible in np.ravel(fields["handle_visibility"])]
        part = self.split.removeprefix("camera_").removeprefix("real_")
        name = f"results_{part}_{self.folder.name}_{frame}.pkl"
        folder = "real_test" if self.split == "real_test" else part
        for root in (self.root, self.root.parent):
            path = root / "results" / "nocs_results" / folder / name
            if path.is_file():
                return _handles_by_box(path, present, masks)
        return [True] * len(present)


def _present(meta: tuple[MetaLine, ...], instance_ids: np.ndarray) -> list[MetaLine]:
    """Lines of objects in the mask that are no distractors, by ascending instance id."""
    in_mask = set(np.unique(instance_ids).tolist())
    lines = [line for line in meta if line.class_id > 0 and line.instance_id in in_mask]
    return sorted(lines, key=lambda line: line.instance_id)


def _handles_by_box(path: Path, present: list[MetaLine], masks: list[np.ndarray]) -> list[bool]:
    """SPD's results have their own order: an object is that of its class with the same box."""
    fields = _fields(path, "gt_class_ids", "gt_bboxes", "gt_handle_visibility")
    class_ids, boxes = np.ravel(fields["gt_class_ids"]), np.asarray(fields["gt_bboxes"])
    handles = []
    for line, mask in zip(present, masks, strict=True):
        differences = np.abs(boxes.reshape(-1, 4).astype(float) - _box(mask)).sum(axis=1)
        differences[class_ids != line.class_id] = np.inf
        found = differences.size and differences.min() <= BOX_TOLERANCE_PX
        best = int(np.argmin(differences)) if found else None
        handles.append(True if best is None else bool(fields["gt_handle_visibility"][best]))
    return handles


def _box(mask: np.ndarray) -> Float[np.ndarray, "4"]:
    """y1, x1, y2, x2 of a mask, the last two exclusive."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    return np.array([rows[0], columns[0], rows[-1] + 1, columns[-1] + 1], dtype=np.float64)


def _fields(path: Path, *required: str) -> dict[str, Any]:
    fields = read_pickle(path)
    missing = [key for key in required if not isinstance(fields, dict) or key not in fields]
    if missing:
        raise DataError(path, f"it lacks {', '.join(missing)}", "Get it again")
    return fields


def _row(values: Any, index: int) -> np.ndarray | None:
    return None if values is None else np.asarray(values, dtype=np.float64)[index]
