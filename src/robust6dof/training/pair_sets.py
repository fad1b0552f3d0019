"""The two sets of a training run: pairs to learn from, and pairs of other shapes to validate."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from robust6dof.frames import CATEGORIES
from robust6dof.network.config import NetworkConfig
from robust6dof.shapes.mesh import ObjectModel
from robust6dof.tracking.view import ViewConfig
from robust6dof.training.pairs import PairConfig, SyntheticPairs
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
    """
    rich = ViewConfig(points=2 * network.points, crop_px=network.crop_px)
    pairs = SyntheticPairs(rich, 2 * network.prior_points, seed, epoch, config, categories, objects)
    view = ViewConfig(points=network.points, crop_px=network.crop_px)
    unseen = replace(config or PairConfig(), first_object=_FIRST_HELD_OUT)
    others = SyntheticPairs(
        view, network.prior_points, seed + 1, held_out, unseen, categories, objects
    )
    return RepeatedPairs(pairs, epoch, network.points, network.prior_points, count), others
