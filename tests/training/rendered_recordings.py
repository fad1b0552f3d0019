"""Small recordings of one rendered object each, written as any user's recording is."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from robust6dof.data.sequence_writer import SequenceWriter
from robust6dof.data.truth_file import FILE_NAME, AnnotatedTruth, write_truth_file
from robust6dof.geometry.transforms import make_transform
from robust6dof.shapes.procedural import make_object
from robust6dof.synthetic.close_up import TARGET_ID, CloseUp, QuickSensor
from robust6dof.training.prediction_errors import turn_and_shift

K = np.array([[120.0, 0, 47.5], [0, 120.0, 47.5], [0, 0, 1]])
SIZE_PX = 96
T_FIRST = make_transform(np.diag([1.0, -1.0, -1.0]), np.array([0.0, 0.0, 0.45]))


def write_recording(
    path: Path, category: str, seed: int, frames: int = 6, truth_file: bool = True
) -> None:
    """An object on a table, a few degrees and millimetres a frame."""
    rng = np.random.default_rng(seed)
    target = make_object(category, seed)
    close_up = CloseUp.on_table(rng, target)
    writer, T_cam_obj, truths = SequenceWriter(path), T_FIRST, []
    for index in range(frames):
        T_cam_obj = turn_and_shift(rng, T_cam_obj, 0.05, 0.003)
        rendering = close_up.render(T_cam_obj, K, SIZE_PX)
        writer.add(QuickSensor().observe(rendering, K, rng), rendering.ids == TARGET_ID, T_cam_obj)
        truths.append(
            AnnotatedTruth(
                name=f"{category}_0",
                category=category,
                T_cam_obj=T_cam_obj,
                extents=target.extents,
                visible_fraction=1.0,
                frame=f"{index:06d}",
            )
        )
    if truth_file:
        write_truth_file(path / FILE_NAME, truths)


def write_recordings(root: Path, categories: tuple[str, ...] = ("mug", "can"), each: int = 2):
    """Several of each category: `<category>_<number>`."""
    for category in categories:
        for number in range(each):
            write_recording(root / f"{category}_{number}", category, seed=number)
    return root
