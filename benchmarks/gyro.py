"""What a gyro is worth: prediction and tracking with and without it, over frames that are missing.

    robust6dof synthesize aerial --split mini --out mini --gyro
    python benchmarks/gyro.py mini --every 6

Starts from the true pose. For each recording and for all: the median error of the predicted pose
(after the motion alone, before the image is looked at) and the frames within 5° and 5 cm.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import tyro

from robust6dof.data.dataset import DatasetSequence, ObjectTruth
from robust6dof.data.truth_file import open_with_truth
from robust6dof.evaluation.frame_choice import FrameChoice
from robust6dof.frames import RgbdFrame, Track
from robust6dof.geometry.transforms import orientation_error
from robust6dof.tracking.motion import seconds_between
from robust6dof.tracking.surface.icp import IcpTracker
from robust6dof.tracking.tracker import Tracker


@dataclass(frozen=True)
class Options:
    """Of the comparison."""

    recordings: Annotated[Path, tyro.conf.Positional]
    """Folder of recordings with `gyro.csv` and ground truth."""
    tracker: Literal["icp", "robust6dof"] = "icp"
    names: str = "*"
    """Pattern of the recordings' names."""
    every: int = 1
    """Each n-th frame only."""
    drop: int = 0
    """So many frames are left out after the first."""


def main(options: Options) -> None:
    found: dict[bool, list[np.ndarray]] = {False: [], True: []}
    for folder in sorted(options.recordings.glob(options.names)):
        choice = FrameChoice(every=options.every, drop=options.drop)
        (sequence,) = choice.of(open_with_truth(folder)).sequences
        for gyro, rows in found.items():
            rows.append(np.array(list(followed(sequence, options.tracker, gyro))))
            report(f"{folder.name}{', gyro' if gyro else ''}", rows[-1])
    for gyro, rows in found.items():
        report(f"all{', gyro' if gyro else ''}", np.concatenate(rows))


def followed(sequence: DatasetSequence, kind: str, gyro: bool) -> Iterator[list[float]]:
    """Of each frame: errors [°, cm] of the prediction, then of the track."""
    (first,) = sequence.truth(0)
    tracker = tracker_of(kind, first.category)
    frame = sequence.frame(0)
    start = frame if gyro else replace(frame, R_ref_cam=None)
    track = tracker.start(start, T_cam_obj=first.T_cam_obj, extents=first.extents)
    for index in range(1, len(sequence)):
        frame = sequence.frame(index)
        frame = frame if gyro else replace(frame, R_ref_cam=None)
        (truth,) = sequence.truth(index)
        T_predicted = predicted(track, frame)
        track = tracker.step(track, frame)
        yield errors(T_predicted, truth) + errors(track.T_cam_obj, truth)


def tracker_of(kind: str, category: str) -> IcpTracker | Tracker:
    if kind == "icp":
        return IcpTracker(category)
    return Tracker.from_pretrained(category=category, device="cpu")


def predicted(track: Track, frame: RgbdFrame) -> np.ndarray:
    """T_cam_obj from which the registration begins."""
    memory = track.memory
    surface = getattr(memory, "surface", None)
    at = surface if isinstance(surface, Track) else track
    seconds = seconds_between(at.stamp, frame.stamp)
    T_cam_model = at.memory.motion.predict(at.T_cam_obj, seconds, frame.R_ref_cam)
    return T_cam_model if at is track else memory.T_cam_obj(replace(at, T_cam_obj=T_cam_model))


def errors(T_cam_obj: np.ndarray, truth: ObjectTruth) -> list[float]:
    R, R_true = T_cam_obj[:3, :3], truth.T_cam_obj[:3, :3]
    gap = np.linalg.norm(T_cam_obj[:3, 3] - truth.T_cam_obj[:3, 3])
    turn = orientation_error(R, R_true, truth.symmetric)
    return [float(np.degrees(turn)), 100 * float(gap)]


def report(name: str, rows: np.ndarray) -> None:
    turn, shift = np.median(rows[:, :2], axis=0)
    within = ((rows[:, 2] < 5) & (rows[:, 3] < 5)).mean()
    print(f"{name}: {len(rows)} frames, predicted {turn:.1f}°, {shift:.1f} cm; {within:.1%}")


if __name__ == "__main__":
    main(tyro.cli(Options))
