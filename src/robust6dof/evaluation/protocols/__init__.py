"""The named protocols: each a pure function from records to scores."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from robust6dof.data.dataset import Dataset
from robust6dof.errors import InputError
from robust6dof.evaluation.captra_truth import with_refitted_truth
from robust6dof.evaluation.protocols import (
    aerial,
    captra,
    nocs_map,
    six_pack,
    six_pack_fixed,
    wild6d,
    ycbineoat_auc,
    ycbv_auc,
)
from robust6dof.evaluation.scores import Scores
from robust6dof.evaluation.start_noise import Start, exact, perturb, shift_uniformly


def as_annotated(dataset: Dataset) -> Dataset:
    """The data set's own truth."""
    return dataset


@dataclass(frozen=True)
class Protocol:
    """How a tracker starts and how its poses are scored."""

    name: str
    score: Callable[..., Scores]
    """(records) → Scores; (records, models) where `needs_models`."""
    start: Callable[..., Start]
    """(T_cam_obj, extents, rng) → what the tracker is told on its first frame."""
    needs_models: bool = False
    """ADD and ADD-S want the object's points."""
    keyframes_only: bool = False
    """Only YCB-Video's keyframes count, where the data set lists them."""
    truth: Callable[[Dataset], Dataset] = as_annotated
    """The data set with the truth that counts, for the start and the score alike."""


_ALL = (
    Protocol("aerial", aerial.score, perturb),
    Protocol("nocs-map", nocs_map.score, exact),
    Protocol("6pack", six_pack.score, shift_uniformly),
    Protocol("6pack-fixed", six_pack_fixed.score, shift_uniformly),
    Protocol("captra", captra.score, perturb, truth=with_refitted_truth),
    Protocol("ycbv-auc", ycbv_auc.score, exact, needs_models=True, keyframes_only=True),
    Protocol("ycbineoat-auc", ycbineoat_auc.score, exact, needs_models=True),
    Protocol("wild6d", wild6d.score, exact),
)
PROTOCOLS: dict[str, Protocol] = {protocol.name: protocol for protocol in _ALL}


def find_protocol(name: str) -> Protocol:
    """The protocol of that name.

    Raises:
        InputError: there is none; the message lists what there is.
    """
    if name not in PROTOCOLS:
        raise InputError(f"no protocol '{name}'; there is: {', '.join(PROTOCOLS)}")
    return PROTOCOLS[name]
