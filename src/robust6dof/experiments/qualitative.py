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
from robust6dof.frames import RgbdFrame
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
        moments = np.linspace(0, count - 1, min(_COLUMNS, count)).astype(int).tolist()
        frames = {index: sequence.frame(index) for index in moments}
        rows = []
        for tracker, records in poses.items():
            pictures = [
                _draw(
                    frame,
                    records.get((sequence.name, index), []),
                    f"{tracker}  {sequence.frame_names[index]}",
                )
                for index, frame in frames.items()
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


def _draw(frame: RgbdFrame, records: list[PoseRecord], label: str) -> UInt8[np.ndarray, "h w 3"]:
    image, K = frame.rgb, frame.K
    for record in records:
        T_true = record.T_cam_obj_true @ record.T_obj_box
        image = draw_box_and_axes(image, K, T_true, record.extents_true, GREEN, axes=False)
        if record.T_cam_obj is not None and not record.lost:
            T_cam_box = record.T_cam_obj @ record.T_obj_box
            image = draw_box_and_axes(image, K, T_cam_box, record.sides, YELLOW, axes=False)
    height = round(image.shape[0] * _WIDTH_PX / image.shape[1])
    small = cv2.resize(image, (_WIDTH_PX, height), interpolation=cv2.INTER_AREA)
    return draw_label(np.asarray(small, np.uint8), label)
