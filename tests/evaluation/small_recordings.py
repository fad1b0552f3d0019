"""Recordings of a few tiny frames with `ground_truth.jsonl`, and trackers to run on them."""

from dataclasses import replace

import cv2
import numpy as np

from robust6dof.data.sequence_writer import write_sequence
from robust6dof.data.truth_file import FILE_NAME, AnnotatedTruth, write_truth_file
from robust6dof.frames import RgbdFrame, Track, TrackState
from robust6dof.geometry.transforms import make_transform

K = np.array([[40.0, 0, 20], [0, 40, 15], [0, 0, 1]])
EXTENTS = np.array([0.1, 0.12, 0.08])
OBJECTS = (("mug_0", "mug"), ("can_0", "can"))


def true_pose(frame, name):
    """Two objects that move 1 cm a frame along x."""
    x = 0.01 * frame + (0.1 if name == "can_0" else -0.1)
    return make_transform(np.diag([1.0, -1.0, -1.0]), np.array([x, 0, 0.8]))


def write_recording(path, frames=5, hidden=()):
    """`hidden` holds (object, frame) pairs of zero visibility."""
    rng = np.random.default_rng(0)
    images = [
        RgbdFrame(
            rng.integers(0, 255, (30, 40, 3), dtype=np.uint8),
            np.full((30, 40), 0.8, np.float32),
            K,
            stamp=i / 30,
            name=f"{i:06d}",
        )
        for i in range(frames)
    ]
    write_sequence(path, images)
    truths = []
    for i in range(frames):
        for name, category in OBJECTS:
            (path / "masks" / name).mkdir(parents=True, exist_ok=True)
            mask = np.zeros((30, 40), np.uint8)
            if (name, i) not in hidden:
                mask[10:20, 5:15] = 255
            cv2.imwrite(str(path / "masks" / name / f"{i:06d}.png"), mask)
            truths.append(
                AnnotatedTruth(
                    name=name,
                    category=category,
                    T_cam_obj=true_pose(i, name),
                    extents=EXTENTS,
                    visible_fraction=0.0 if (name, i) in hidden else 0.9,
                    frame=f"{i:06d}",
                    stamp=i / 30,
                    symmetric=category == "can",
                    difficulty="easy",
                )
            )
    write_truth_file(path / FILE_NAME, truths)


class StandingTracker:
    """Keeps its first pose; calls itself lost on the frames named."""

    def __init__(self, category, lost=()):
        self.category = category
        self.lost = lost
        self.hints = []

    def start(self, frame, *, mask=None, box=None, T_cam_obj=None, extents=None):
        self.hints.append((frame.name, mask, T_cam_obj, extents))
        return Track(T_cam_obj, extents, 0.9, TrackState.TRACKING, self.category)

    def step(self, track, frame):
        state = TrackState.LOST if frame.name in self.lost else TrackState.TRACKING
        return replace(track, state=state)


def make_standing(category, cad=None, exact_start=False):
    return StandingTracker(category)


def make_lost(category, cad=None, exact_start=False):
    return StandingTracker(category, lost=("000002", "000003"))
