"""Train one row of an ablation at a small, stated budget; a row cut short goes on."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from robust6dof.experiments.setting import Setting
from robust6dof.network.config import NetworkConfig
from robust6dof.network.device import resolve_device
from robust6dof.training.loop import TrainConfig, train
from robust6dof.training.losses import LossConfig
from robust6dof.training.pair_sets import make_pair_sets
from robust6dof.training.recipe import recipe_named

_EPOCH = 600
"""Distinct pairs, seen again with other points."""
_HELD_OUT = 12
"""Pairs of other shapes, for the log."""


def train_row(setting: Setting, label: str, network: NetworkConfig, losses: LossConfig) -> Path:
    """Weights of one configuration; the same pairs for all rows.

    Rows that several experiments share are trained once, beside the experiments' folders.
    """
    steps = setting.steps or setting.size.steps
    short = label.replace(" ", "-").replace("+", "-")
    name = "M5" if short in ("ours", "all") else short
    out = setting.out.parent / "trained" / f"{setting.size.preset}-{steps}-{name}"
    weights = out / "network.safetensors"
    if (out / "done").is_file():
        return weights
    batch = min(8, recipe_named("short").batch)
    recipe = replace(recipe_named("short"), steps=steps, batch=batch)
    count = steps * batch
    pairs, held_out = make_pair_sets(network, setting.seed, min(_EPOCH, count), count, _HELD_OUT)
    train(
        TrainConfig(network, recipe, losses, setting.seed),
        pairs,
        held_out,
        out,
        device=resolve_device(setting.device),
    )
    (out / "done").touch()
    return weights
