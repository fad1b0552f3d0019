"""The part of a data set on disk that may be trained on."""

from __future__ import annotations

import json
import warnings
from dataclasses import replace
from pathlib import Path

from robust6dof.data.dataset import Dataset
from robust6dof.data.nocs import FOLDERS, NocsSplit, open_nocs
from robust6dof.data.recognition import recognise
from robust6dof.data.truth_file import open_with_truth
from robust6dof.data.ycb_video import TEST_VIDEOS, open_ycb_video
from robust6dof.errors import DataError, Robust6dofWarning
from robust6dof.synthetic.plans import SPLITS

_NOCS_SPLITS: tuple[NocsSplit, ...] = ("camera_train", "real_train")


def open_training_split(path: str | Path, models: str | Path | None = None) -> Dataset:
    """Open what a folder holds, its layout recognised; of NOCS and YCB-Video the training splits.

    Args:
        path: recordings, NOCS or YCB-Video.
        models: for YCB-Video, where the object models lie if not in its `models/`.

    Raises:
        DataError: not recognised, not readable, or only test data is there.
    """
    path = Path(path)
    kind = recognise(path)
    if kind == "nocs":
        return _nocs(path)
    if kind == "ycb-video":
        return _ycb_video(path, models)
    if kind == "wild6d":
        raise DataError(
            path, "this is Wild6D's test set", "Train on something else; it is for evaluation"
        )
    dataset = open_with_truth(path)
    _warn_of_benchmarks(dataset)
    return dataset


def _nocs(path: Path) -> Dataset:
    parts = [open_nocs(path, split) for split in _NOCS_SPLITS if _has_nocs(path, split)]
    if not parts:
        raise DataError(
            path,
            "there is no training split of NOCS",
            "Training takes the root above train/ (CAMERA, with camera_full_depths/) or "
            "real_train/, or SPD's CAMERA/train and Real/train",
        )
    sequences = tuple(sequence for part in parts for sequence in part.sequences)
    return replace(parts[0], name="nocs-train", sequences=sequences)


def _has_nocs(path: Path, split: NocsSplit) -> bool:
    """Whether that split's own folder is there (a lone scene is not known to be of it)."""
    return any(
        next((root / folder).glob("*/*_color.png"), None) is not None
        for root in (path, path / "data")
        for folder in FOLDERS[split]
    )


def _ycb_video(path: Path, models: str | Path | None) -> Dataset:
    dataset = open_ycb_video(path, models=models)
    tests = {f"{number:04d}" for number in TEST_VIDEOS}
    kept = tuple(sequence for sequence in dataset.sequences if sequence.name not in tests)
    if not kept:
        first, last = TEST_VIDEOS[0], TEST_VIDEOS[-1]
        raise DataError(
            path,
            f"only test videos of YCB-Video ({first:04d} to {last:04d}) are here",
            "Training takes the others",
        )
    return replace(dataset, name="ycb-video-train", sequences=kept)


def _warn_of_benchmarks(dataset: Dataset) -> None:
    """Recordings that scores are reported on: YCBInEOAT, and the seeds of AerialPose-Sim."""
    seeds = {seed for split in SPLITS.values() for seed in split.seeds}
    plans = [*dataset.path.glob("plan.json"), *dataset.path.glob("**/plan.json")]
    scored = [p for p in plans if json.loads(p.read_text()).get("seed", -1) // 1_000_000 in seeds]
    name = "AerialPose-Sim" if scored else "YCBInEOAT" if dataset.name == "ycbineoat" else ""
    if name:
        warnings.warn(
            f"{dataset.path} holds recordings of the benchmark {name}: scores of these weights on "
            "it would mean nothing",
            Robust6dofWarning,
            stacklevel=2,
        )
