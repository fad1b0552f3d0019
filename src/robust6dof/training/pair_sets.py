"""The two sets of a training run: pairs to learn from, and pairs of other shapes to validate.

Rendered ones validate on shapes never trained on, recorded ones on sequences never trained on.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from robust6dof.errors import InputError
from robust6dof.frames import CATEGORIES
from robust6dof.network.config import NetworkConfig
from robust6dof.shapes.mesh import ObjectModel
from robust6dof.tracking.view import ViewConfig
from robust6dof.training.pairs import PairConfig, SyntheticPairs
from robust6dof.training.prediction_errors import Replayed
from robust6dof.training.recorded_clips import Clip, split_clips
from robust6dof.training.recorded_pairs import RecordedPairs
from robust6dof.training.repeated_pairs import RepeatedPairs

_FIRST_HELD_OUT = 1_000_000


def make_pair_sets(
    network: NetworkConfig,
    seed: int,
    epoch: int,
    count: int,
    held_out: int,
    categories: Sequence[str] = CATEGORIES,
    objects: Mapping[str, Sequence[ObjectModel]] | None = None,
    config: PairConfig | None = None,
    replayed: Replayed | None = None,
) -> tuple[RepeatedPairs, SyntheticPairs]:
    """Pairs to train on, and pairs held out.

    Args:
        network: how many points, of the view and of the prior, and what crop it takes.
        seed: of the pairs; those held out have the next.
        epoch: distinct pairs, made with twice the points and seen again with others of them.
        count: of all pairs to train on: steps times batch.
        held_out: how many pairs of shapes never trained on; of `objects`, other views.
        categories: of the objects.
        objects: the user's own of some categories, seen instead of procedural ones.
        config: what the pairs vary; the usual where not given.
        replayed: a tracker's own errors, for a share of the predictions trained with.
    """
    pairs = SyntheticPairs(
        *_view_and_prior(network, 2), seed, epoch, config, categories, objects, replayed=replayed
    )
    unseen = replace(config or PairConfig(), first_object=_FIRST_HELD_OUT)
    others = SyntheticPairs(
        *_view_and_prior(network), seed + 1, held_out, unseen, categories, objects
    )
    return RepeatedPairs(pairs, epoch, network.points, network.prior_points, count), others


def make_recorded_sets(
    network: NetworkConfig,
    seed: int,
    epoch: int,
    count: int,
    held_out: int,
    clips: Sequence[Clip],
    most_gap: int = 8,
    replayed: Replayed | None = None,
) -> tuple[RepeatedPairs, RecordedPairs | None]:
    """The same from recordings: the sequences held out are never trained on.

    Args:
        network: how many points, of the view and of the prior, and what crop it takes.
        seed: of the pairs and of which sequences are held out; pairs held out have the next.
        epoch: distinct pairs, made with twice the points and seen again with others of them.
        count: of all pairs to train on: steps times batch.
        held_out: how many pairs of the sequences held out; with 0 none is, and all are trained on.
        clips: what to learn from.
        most_gap: largest distance of a pair's frames in the recording.
        replayed: a tracker's own errors, for a share of the predictions trained with.

    Raises:
        InputError: no sequence can be held out.
    """
    learned, kept = split_clips(clips, seed) if held_out else (list(clips), [])
    if held_out and not kept:
        raise InputError(
            "no recording can be held out for validation, as each category is in one alone: add "
            "another, or train without validation (--held-out 0)"
        )
    pairs = RecordedPairs(
        learned, *_view_and_prior(network, 2), seed, epoch, most_gap=most_gap, replayed=replayed
    )
    repeated = RepeatedPairs(pairs, epoch, network.points, network.prior_points, count)
    if not held_out:
        return repeated, None
    return repeated, RecordedPairs(kept, *_view_and_prior(network), seed + 1, held_out, most_gap)


def _view_and_prior(network: NetworkConfig, times: int = 1) -> tuple[ViewConfig, int]:
    """View and number of prior points, `times` those of the network; `RepeatedPairs` chooses from
    twice as many."""
    view = ViewConfig(points=times * network.points, crop_px=network.crop_px)
    return view, times * network.prior_points
