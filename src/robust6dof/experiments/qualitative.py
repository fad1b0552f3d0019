"""The qualitative figures: prediction yellow, truth green, a baseline beside, left to right in
time."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import UInt8

from robust6dof.data.image_files import write_image
from robust6dof.evaluation.data_kind import data_kind
from robust6dof.evaluation.records import PoseRecord
from robust6dof.experiments.report import Report
from robust6dof.experiments.setting import Setting
from robust6dof.visualization.overlay import GREEN, YELLOW, draw_box_and_axes, draw_label

_COLUMNS = 5
_WIDTH_PX = 320


def qualitative(setting: Setting) -> Report:
    """One picture for each sequence: a row for each tracker, five moments."""
    poses = {tracker: _by_frame(setting, tracker) for tracker in setting.trackers[:2]}
    setting.out.mkdir(parents=True, exist_ok=True)
    figures = []
    for sequence in setting.dataset().sequences:
        count = min(len(sequence), setting.size.frames or len(sequence))
        moments = np.linspace(0, count - 1, min(_COLUMNS, count)).astype(int)
        rows = []
        for tracker, records in poses.items():
            pictures = [
                _draw(
                    sequence.frame(int(i)).rgb,
                    sequence.frame(int(i)).K,
                    records.get((sequence.name, int(i)), []),
                    f"{tracker}  {sequence.frame_names[int(i)]}",
                )
                for i in moments
            ]
            rows.append(np.concatenate(pictures, axis=1))
        path = setting.out / f"{sequence.name.replace('/', '_')}.png"
        write_image(path, np.concatenate(rows, axis=0))
        figures.append(path)
    return Report(
        "Qualitative comparison: prediction yellow, truth green",
        data_kind(setting.dataset_path()),
        (),
        (),
        tuple(figures),
        ("left to right in time; one row for each tracker; a lost pose is not drawn",),
        "aerial",
    )


def _by_frame(setting: Setting, tracker: str) -> dict[tuple[str, int], list[PoseRecord]]:
    stored = setting.stored(setting.predict(tracker, "aerial"), "aerial")
    frames: dict[tuple[str, int], list[PoseRecord]] = {}
    for record in stored.records:
        frames.setdefault((record.sequence, record.frame), []).append(record)
    return frames


def _draw(
    rgb: UInt8[np.ndarray, "H W 3"], K: np.ndarray, records: list[PoseRecord], label: str
) -> UInt8[np.ndarray, "h w 3"]:
    image = rgb
    for record in records:
        T_true, extents = _boxed(record, record.T_cam_obj_true), record.extents_true
        image = draw_box_and_axes(image, K, T_true, extents, GREEN, axes=False)
        if record.T_cam_obj is not None and not record.lost:
            predicted = extents if record.extents is None else record.extents
            T_cam_box = _boxed(record, record.T_cam_obj)
            image = draw_box_and_axes(image, K, T_cam_box, predicted, YELLOW, axes=False)
    height = round(rgb.shape[0] * _WIDTH_PX / rgb.shape[1])
    small = cv2.resize(image, (_WIDTH_PX, height), interpolation=cv2.INTER_AREA)
    return draw_label(np.asarray(small, np.uint8), label)


def _boxed(record: PoseRecord, T_cam_obj: np.ndarray) -> np.ndarray:
    """The pose of the box, for models that are not centred."""
    T_cam_box = T_cam_obj.copy()
    T_cam_box[:3, 3] += T_cam_obj[:3, :3] @ record.box_center
    return T_cam_box
