"""Train one row of an ablation at a small, stated budget; a row cut short goes on."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache
from pathlib import Path

from robust6dof.experiments.setting import Setting
from robust6dof.network.config import NetworkConfig, ablation, preset
from robust6dof.network.device import resolve_device
from robust6dof.training.loop import TrainConfig, train
from robust6dof.training.losses import LossConfig
from robust6dof.training.pair_sets import make_pair_sets
from robust6dof.training.pairs import SyntheticPairs
from robust6dof.training.recipe import Recipe, recipe_named
from robust6dof.training.repeated_pairs import RepeatedPairs

_BATCH = 8
_EPOCH = 600
"""Distinct pairs, seen again with other points."""
_HELD_OUT = 12
"""Pairs of other shapes, for the log."""


def train_row(setting: Setting, label: str, name: str, losses: LossConfig, seed: int) -> Path:
    """Weights of one configuration; for one seed all rows see the same pairs.

    Rows that several experiments share are trained once, beside the experiments' folders.

    Args:
        setting: decides the network's preset, the steps and the device.
        label: of the row in its table.
        name: of the network's configuration; see `network.config.ablation`.
        losses: to train with.
        seed: of the pairs and of the network's first weights.
    """
    base, steps = preset(setting.preset), setting.training_steps
    row = "M5" if label in ("ours", "all") else label.replace(" ", "-").replace("+", "-")
    out = setting.out.parent / "trained" / f"{setting.preset}-{steps}-{row}-seed{seed}"
    if not (out / "done").is_file():
        pairs, held_out = _pair_sets(base, seed, steps * _BATCH)
        config = TrainConfig(ablation(name, base), budget_recipe(steps), losses, seed)
        train(config, pairs, held_out, out, device=resolve_device(setting.device))
        (out / "done").touch()
    return out / "network.safetensors"


def budget_recipe(steps: int) -> Recipe:
    """The recipe `short` over so many steps: the mean of the weights reaches back a twentieth of
    them, so that the first, random weights are forgotten."""
    short = recipe_named("short")
    return replace(short, steps=steps, batch=_BATCH, ema=max(0.0, min(short.ema, 1 - 20 / steps)))


@lru_cache(maxsize=1)
def _pair_sets(
    network: NetworkConfig, seed: int, count: int
) -> tuple[RepeatedPairs, SyntheticPairs]:
    """Kept for the next row: making the pairs takes as long as a small network's steps."""
    return make_pair_sets(network, seed, min(_EPOCH, count), count, _HELD_OUT)
