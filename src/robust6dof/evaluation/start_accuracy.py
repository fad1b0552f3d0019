"""How often a tracker starts rightly, by what it was told of the object: protocol `start`.

Each chosen frame is a first frame of its own: the tracker is started on it from one kind of hint,
and its first pose is compared with the truth, of which nothing but the hint reaches it.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from jaxtyping import Bool, Float

from robust6dof.data.dataset import DatasetSequence, ObjectTruth
from robust6dof.errors import InputError, Robust6dofError
from robust6dof.evaluation.intervals import Interval
from robust6dof.evaluation.metrics import rotation_err_deg, translation_err_cm
from robust6dof.evaluation.records import by_annotation_or_category
from robust6dof.evaluation.scores import Row
from robust6dof.evaluation.start_noise import perturb
from robust6dof.frames import Box, PoseTracker, RgbdFrame, Track
from robust6dof.geometry.boxes import box_corners
from robust6dof.geometry.camera import project
from robust6dof.tracking.segmentation import segment_click

Hint = Literal["pose", "mask", "box", "click", "category"]
HINTS: tuple[Hint, ...] = ("pose", "mask", "box", "click", "category")
"""The true pose and size with "Pert." noise; the true mask; its image box; a pixel of it, drawn at
random; nothing but the category."""

THRESHOLDS: dict[str, tuple[float, float]] = {"10°5cm": (10.0, 5.0), "20°10cm": (20.0, 10.0)}


@dataclass(frozen=True, eq=False)
class StartCase:
    """One object in one frame."""

    sequence: str
    frame: RgbdFrame
    truth: ObjectTruth
    alike: tuple[ObjectTruth, ...] = ()
    """Known others of its category in the image: the category alone may mean any of them."""


@dataclass(frozen=True)
class StartTrial:
    """One start and how far off it was; infinite where the tracker gave no pose."""

    sequence: str
    frame: str
    object_name: str
    category: str
    hint: str
    rotation_deg: float
    translation_cm: float
    scale_ratio: float
    """Estimated over true diagonal; NaN where either is unknown."""
    confidence: float
    seconds: float
    problem: str = ""
    """Why there is no pose."""

    def is_within(self, threshold: str) -> bool:
        degrees, centimetres = THRESHOLDS[threshold]
        return self.rotation_deg < degrees and self.translation_cm < centimetres


def choose_cases(
    sequence: DatasetSequence, count: int, least_visible: float = 0.5
) -> Iterator[StartCase]:
    """For each object up to `count` frames, evenly spread over those in which enough shows."""
    showing: dict[str, list[int]] = {}
    for index in range(len(sequence)):
        for truth in sequence.truth(index):
            if truth.visible_fraction is None or truth.visible_fraction >= least_visible:
                showing.setdefault(truth.name, []).append(index)
    for name, indices in showing.items():
        for place in np.unique(np.linspace(0, len(indices) - 1, count).round().astype(int)):
            index = indices[place]
            truth = next(truth for truth in sequence.truth(index) if truth.name == name)
            yield StartCase(sequence.name, sequence.frame(index), truth)


def try_start(
    case: StartCase, hint: Hint, tracker: PoseTracker, rng: np.random.Generator
) -> tuple[StartTrial, Track | None]:
    """Start once; the track is None where the tracker refused, which counts as a miss.

    Raises:
        InputError: the hint cannot be made, as the data set lacks what it takes.
    """
    made = _hint(case, hint, rng)
    began, track, problem = time.perf_counter(), None, ""
    try:
        track = tracker.start(case.frame, **made())
    except Robust6dofError as error:
        problem = str(error)
    seconds = time.perf_counter() - began
    rotation_deg, translation_cm, scale_ratio = _errors(case, hint, track)
    trial = StartTrial(
        case.sequence,
        case.frame.name,
        case.truth.name,
        case.truth.category,
        hint,
        rotation_deg,
        translation_cm,
        scale_ratio,
        track.confidence if track else 0.0,
        seconds,
        problem,
    )
    return trial, track


@dataclass(frozen=True)
class StartSummary:
    """The starts of one category, or of all, from one kind of hint."""

    category: str
    hint: str
    starts: int
    recordings: int
    share: Row
    """Within each threshold [%]."""
    interval: Interval
    """95 % Wilson intervals of `share`, for as many trials as there are recordings: starts in one
    recording are not independent."""
    median: Row
    """Errors of the poses given, and the time [s]."""


def summarize(trials: Sequence[StartTrial]) -> list[StartSummary]:
    """For each hint: each category, then all together."""
    rows = []
    for hint in [hint for hint in HINTS if any(trial.hint == hint for trial in trials)]:
        told = [trial for trial in trials if trial.hint == hint]
        for category in sorted({trial.category for trial in told}):
            part = [trial for trial in told if trial.category == category]
            rows.append(_summary(category, hint, part))
        rows.append(_summary("all", hint, told))
    return rows


def wilson_interval(share: float, count: int) -> tuple[float, float]:
    """95 % interval of a share [%] seen in `count` independent trials (Wilson, 1927)."""
    z, p = 1.959964, share / 100.0
    middle = (p + z**2 / (2 * count)) / (1 + z**2 / count)
    reach = z / (1 + z**2 / count) * np.sqrt(p * (1 - p) / count + z**2 / (4 * count**2))
    return float(100 * max(middle - reach, 0.0)), float(100 * min(middle + reach, 1.0))


def _summary(category: str, hint: str, trials: Sequence[StartTrial]) -> StartSummary:
    recordings = len({trial.sequence for trial in trials})
    share = {
        name: 100.0 * float(np.mean([trial.is_within(name) for trial in trials]))
        for name in THRESHOLDS
    }
    posed = [trial for trial in trials if np.isfinite(trial.rotation_deg)]
    median = {
        name: float(np.median([getattr(trial, name) for trial in posed])) if posed else np.nan
        for name in ("rotation_deg", "translation_cm", "seconds")
    }
    interval = {name: wilson_interval(value, recordings) for name, value in share.items()}
    return StartSummary(category, hint, len(trials), recordings, share, interval, median)


def _hint(case: StartCase, hint: Hint, rng: np.random.Generator) -> Callable[[], dict[str, Any]]:
    """Arguments of `start`, made when asked for: a click is segmented within the start's time."""
    truth, frame = case.truth, case.frame
    if hint == "pose":
        T_cam_obj, extents = perturb(truth.T_cam_box, truth.extents, rng)
        return lambda: {"T_cam_obj": T_cam_obj, "extents": extents}
    if hint == "category":
        return dict
    if hint == "box":
        box = _image_box(case)
        return lambda: {"box": box}
    if hint == "click":
        x, y = _pixel_on(case, rng)
        return lambda: {"mask": segment_click(frame, x, y).mask}
    mask = _mask(truth)
    return lambda: {"mask": mask}


def _mask(truth: ObjectTruth) -> Bool[np.ndarray, "H W"]:
    if truth.mask is None:
        raise InputError(f"the data set has no mask of {truth.name}; leave the hint mask out")
    return truth.mask


def _image_box(case: StartCase) -> Box:
    """Around the mask; around the true box where there is no mask."""
    truth = case.truth
    if truth.mask is not None:
        y, x = np.nonzero(truth.mask)
        pixels = np.stack([x, y], axis=-1).astype(float)
    else:
        extents = _known_extents(truth)
        pixels = project(box_corners(truth.T_cam_box, extents), case.frame.K)
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    return Box(*low.tolist(), *(high - low).tolist())


def _pixel_on(case: StartCase, rng: np.random.Generator) -> tuple[float, float]:
    """A pixel of the mask; without one, the middle of the object."""
    if case.truth.mask is None:
        x, y = project(case.truth.T_cam_box[None, :3, 3], case.frame.K)[0]
        return float(x), float(y)
    y, x = np.nonzero(case.truth.mask)
    drawn = int(rng.integers(len(x)))
    return float(x[drawn]), float(y[drawn])


def _known_extents(truth: ObjectTruth) -> Float[np.ndarray, "3"]:
    if truth.extents is None:
        raise InputError(f"the data set has neither mask nor size of {truth.name}")
    return truth.extents


def _errors(case: StartCase, hint: Hint, track: Track | None) -> tuple[float, float, float]:
    """Rotation [deg], translation [cm] and scale ratio, against the nearest that can be meant."""
    if track is None:
        return float("inf"), float("inf"), float("nan")
    meant = (case.truth, *case.alike) if hint == "category" else (case.truth,)
    nearest = min(
        meant, key=lambda one: np.linalg.norm(one.T_cam_box[:3, 3] - track.T_cam_obj[:3, 3])
    )
    ours, true = track.T_cam_obj[None], nearest.T_cam_box[None]
    symmetric = np.array([by_annotation_or_category(nearest)])
    rotation_deg = float(rotation_err_deg(ours, true, symmetric)[0])
    scale = np.nan if nearest.extents is None else float(np.linalg.norm(nearest.extents))
    return rotation_deg, float(translation_err_cm(ours, true)[0]), track.scale / scale
