"""Training pairs from recordings on disk: two frames of one object, a random gap apart."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float

from robust6dof.data.dataset import ObjectTruth
from robust6dof.frames import RgbdFrame
from robust6dof.geometry.transforms import invert_transform, transform_points
from robust6dof.network.inputs import to_camera
from robust6dof.tracking.view import View, ViewConfig
from robust6dof.training.drawn_pairs import LEAST_ON_OBJECT, DrawnPairs, SeenView
from robust6dof.training.pair_batch import PairBatch
from robust6dof.training.prediction_errors import ErrorConfig, ErrorSource, Replayed
from robust6dof.training.recorded_clips import Clip, true_box

_OUTSIDE_BOX = 0.05
"""How far outside its annotated box a point may lie and be the object's, in diagonals: masks
overlap their neighbours, and depth smears over edges."""


class RecordedPairs(DrawnPairs):
    """Pairs of recorded frames; see `DrawnPairs`.

    The second frame is up to `most_gap` frames before or after the first. Where the object is not
    annotated in it (single images, an object that leaves), the first stands for both, as it does
    when a track starts.

    Args:
        clips: to draw from; their categories take turns.
        view: what is cut out of a frame.
        prior_points: N_r.
        seed: of all pairs.
        count: length of this data set.
        most_gap: largest distance of the two frames in the recording.
        errors: of the predictions.
        replayed: a tracker's own errors, for a share of the predictions.
    """

    def __init__(
        self,
        clips: Sequence[Clip],
        view: ViewConfig,
        prior_points: int,
        seed: int,
        count: int,
        most_gap: int = 8,
        errors: ErrorConfig | None = None,
        replayed: Replayed | None = None,
    ) -> None:
        self.clips: dict[str, list[Clip]] = {}
        for clip in clips:
            self.clips.setdefault(clip.category, []).append(clip)
        source = ErrorSource(errors or ErrorConfig(), replayed or {})
        super().__init__(view, prior_points, seed, count, sorted(self.clips), source)
        self.most_gap = most_gap

    def _draw(self, rng: np.random.Generator, category: str) -> PairBatch | None:
        clips = self.clips[category]
        clip = clips[int(rng.integers(len(clips)))]
        first, second = _two_frames(rng, len(clip.sequence), self.most_gap)
        truth_prev = clip.truth(first)
        if truth_prev is None:
            return None
        truth_cur = clip.truth(second)
        if truth_cur is None:
            second, truth_cur = first, truth_prev
        frame_prev = clip.sequence.frame(first)
        frame_cur = frame_prev if second == first else clip.sequence.frame(second)
        T_prev, extents = true_box(truth_prev)
        errors = self.errors.draw(rng, category)
        extents_pred = extents * errors.stretch
        T_pred = errors.previous(rng, T_prev)
        previous = self._read(rng, frame_prev, truth_prev, T_pred, extents_pred)
        T_pred = errors.current(rng, T_prev)
        current = self._read(rng, frame_cur, truth_cur, T_pred, extents_pred)
        if previous is None or current is None:
            return None
        return self._assemble(rng, category, float(np.linalg.norm(extents)), previous, current)

    def _read(
        self,
        rng: np.random.Generator,
        frame: RgbdFrame,
        truth: ObjectTruth,
        T_cam_pred: Float[np.ndarray, "4 4"],
        extents_pred: Float[np.ndarray, "3"],
    ) -> SeenView | None:
        """One view; None where too little of the object is seen."""
        T_cam_obj, extents = true_box(truth)
        mask = np.zeros(frame.depth.shape, bool) if truth.mask is None else truth.mask
        seen = self._see(rng, frame, mask, T_cam_obj, T_cam_pred, extents_pred)
        if seen is None:
            return None
        on_object = seen.on_object & _inside_box(seen.view, T_cam_obj, extents)
        if on_object.mean() < LEAST_ON_OBJECT:
            return None
        return replace(seen, on_object=on_object, handle_visible=truth.handle_visible)


def _two_frames(rng: np.random.Generator, count: int, most_gap: int) -> tuple[int, int]:
    first = int(rng.integers(count))
    gap = int(rng.integers(1, most_gap + 1)) * int(rng.choice([-1, 1]))
    return first, int(np.clip(first + gap, 0, count - 1))


def _inside_box(
    view: View, T_cam_obj: Float[np.ndarray, "4 4"], extents: Float[np.ndarray, "3"]
) -> Bool[np.ndarray, "N"]:
    """Which points of a view lie in the true box, grown a little."""
    batch = view.batch
    points_cam = to_camera(batch.points, batch.T_cam_pred, batch.scale)[0].double().numpy()
    points = transform_points(invert_transform(T_cam_obj), points_cam)
    margin = _OUTSIDE_BOX * float(np.linalg.norm(extents))
    return np.all(np.abs(points) <= extents / 2 + margin, axis=1)
