"""Which recordings on disk can be learned from: opened, checked, and split by sequence."""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from robust6dof.data.dataset import Dataset, DatasetSequence, ObjectTruth
from robust6dof.errors import DataError, InputError, Robust6dofWarning
from robust6dof.evaluation.ycb_axes import other_sides, upright_box
from robust6dof.frames import YCB_OBJECTS
from robust6dof.shapes.priors import load_prior
from robust6dof.shapes.ycb_objects import known_extents
from robust6dof.training.training_splits import open_training_split

_LOOKED_AT = 3
"""Frames of each sequence, spread evenly, that tell what it shows."""
_HELD_OUT_SHARE = 5
"""One in so many sequences is held out, and one of each category at least."""


@dataclass(frozen=True, eq=False)
class Clip:
    """One object in one sequence."""

    sequence: DatasetSequence
    name: str
    """Of the object, in its sequence."""
    category: str

    def truth(self, index: int) -> ObjectTruth | None:
        """What is annotated of the object in a frame; None where pose or mask is missing."""
        for truth in self.sequence.truth(index):
            if truth.name == self.name and truth.mask is not None and truth.mask.any():
                return truth
        return None


@dataclass(frozen=True)
class _Refusal:
    sequence: str
    problem: str
    remedy: str


def open_clips(
    path: str | Path, categories: Sequence[str] = (), models: str | Path | None = None
) -> list[Clip]:
    """Every object of a folder that can be learned from, whatever its layout.

    The layout is recognised as `robust6dof doctor` does; of NOCS and YCB-Video only the training
    splits are taken. What cannot be learned from is left out with a warning.

    Args:
        path: recordings, NOCS or YCB-Video.
        categories: only these; all if empty.
        models: for YCB-Video, where the object models lie.

    Raises:
        DataError: nothing can be learned from: no poses, no masks, no sizes, no known category.
    """
    dataset = open_training_split(path, models)
    clips: list[Clip] = []
    refusals: list[_Refusal] = []
    for sequence in dataset.sequences:
        for found in _examine(sequence):
            if isinstance(found, _Refusal):
                refusals.append(found)
            elif not categories or found.category in categories:
                clips.append(found)
    if not clips:
        raise _nothing(dataset, categories, refusals)
    if refusals:
        first = refusals[0]
        text = f"{dataset.path}: {len(refusals)} left out; {first.sequence}: {first.problem}"
        warnings.warn(text, Robust6dofWarning, stacklevel=2)
    return clips


def _nothing(dataset: Dataset, categories: Sequence[str], refusals: list[_Refusal]) -> DataError:
    if refusals:
        first = refusals[0]
        return DataError(dataset.path, f"{first.sequence}: {first.problem}", first.remedy)
    wanted = ", ".join(categories)
    return DataError(dataset.path, f"it shows none of: {wanted}", "Choose other --categories")


def _examine(sequence: DatasetSequence) -> Iterator[Clip | _Refusal]:
    """The objects of a sequence, by a few of its frames."""
    seen: dict[str, list[ObjectTruth]] = {}
    for index in np.unique(np.linspace(0, len(sequence) - 1, _LOOKED_AT).astype(int)):
        for truth in sequence.truth(int(index)):
            seen.setdefault(truth.name, []).append(truth)
    if not seen:
        yield _Refusal(
            sequence.name,
            "it has no object poses",
            "Training needs annotated_poses/ and masks/, or ground_truth.jsonl "
            "(docs/evaluation.md)",
        )
    for name, truths in seen.items():
        refusal = _refusal(sequence.name, truths)
        yield refusal or Clip(sequence, name, truths[0].category)


def _refusal(sequence: str, truths: list[ObjectTruth]) -> _Refusal | None:
    category = truths[0].category
    try:
        load_prior(category)
    except InputError:
        if category == "unknown":
            problem = "of which category its object is, is not said"
            return _Refusal(sequence, problem, "Say it in ground_truth.jsonl (docs/evaluation.md)")
        remedy = "Build one with robust6dof priors, or name others by --categories"
        return _Refusal(sequence, f"it shows '{category}', of which no prior is known", remedy)
    if all(truth.mask is None for truth in truths):
        remedy = "Training needs masks/<frame>.png or masks/<object>/<frame>.png beside the poses"
        return _Refusal(sequence, f"there are no masks of {truths[0].name}", remedy)
    if _extents(truths[0]) is None:
        remedy = "Write extents_m in ground_truth.jsonl (docs/evaluation.md)"
        return _Refusal(sequence, f"the size of {truths[0].name} is not known", remedy)
    return None


def _extents(truth: ObjectTruth) -> Float[np.ndarray, "3"] | None:
    if truth.extents is not None:
        return truth.extents
    known = known_extents(truth.category)
    return None if known is None else other_sides(known)


def true_box(truth: ObjectTruth) -> tuple[Float[np.ndarray, "4 4"], Float[np.ndarray, "3"]]:
    """`T_cam_obj` and sides in the object frame of this package: box at the origin, y up.

    YCB's objects are annotated in YCB-Video's axes and are turned; any other object's are taken as
    they are. A YCB object without a size has the known one.

    Raises:
        InputError: no size is annotated or known.
    """
    extents = _extents(truth)
    if extents is None:
        raise InputError(f"the size of {truth.name} is not annotated")
    return upright(truth.category, truth.T_cam_box, extents)


def upright(
    category: str, T_cam_box: Float[np.ndarray, "4 4"], extents: Float[np.ndarray, "3"]
) -> tuple[Float[np.ndarray, "4 4"], Float[np.ndarray, "3"]]:
    """A box in the axes of this package, of one in its data set's."""
    return upright_box(T_cam_box, extents) if category in YCB_OBJECTS else (T_cam_box, extents)


def split_clips(clips: Sequence[Clip], seed: int) -> tuple[list[Clip], list[Clip]]:
    """Clips to train on, and clips of other sequences.

    Every category stays with the training ones; one in five sequences is held out, and of every
    category that is in two or more sequences at least one. The second list is empty where each
    category is in one sequence alone.
    """
    shows: dict[str, set[str]] = {}
    for clip in clips:
        shows.setdefault(clip.sequence.name, set()).add(clip.category)
    left = Counter(category for categories in shows.values() for category in categories)
    names = sorted(shows)
    held: set[str] = set()
    covered: set[str] = set()
    for name in np.random.default_rng(seed).permutation(names).tolist():
        wanted = len(held) < len(names) // _HELD_OUT_SHARE or not shows[name] <= covered
        if wanted and all(left[category] > 1 for category in shows[name]):
            held.add(name)
            covered |= shows[name]
            left.subtract(shows[name])
    return (
        [clip for clip in clips if clip.sequence.name not in held],
        [clip for clip in clips if clip.sequence.name in held],
    )
