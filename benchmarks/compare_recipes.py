"""Train one small network by each recipe on the same pairs, over several seeds; as a table.

python benchmarks/compare_recipes.py out/recipes

All recipes see the same pairs, equally often: the batch differs, so the number of steps does. A
run that was cut short goes on. A difference that is smaller than that between seeds is none.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
import tyro
from safetensors.torch import load_file
from torch.utils.data import DataLoader, Dataset
from tyro.conf import Positional

from robust6dof.network.config import NetworkConfig, preset
from robust6dof.network.robust6dof_net import Robust6DofNet
from robust6dof.training.loop import TrainConfig, train
from robust6dof.training.pair_batch import PairBatch, collate
from robust6dof.training.pair_sets import make_pair_sets
from robust6dof.training.recipe import Recipe, recipe_named
from robust6dof.training.validation import validate

COLUMNS = ("anchor_5deg5cm", "anchor_deg", "anchor_cm", "step_5deg5cm", "step_deg")


def recipes(seen: int) -> dict[str, Recipe]:
    """What is compared, over so many pairs; the mean reaches back the share that `short`'s does."""
    paper, short = recipe_named("paper"), recipe_named("short")
    steps = seen // short.batch
    ema = 1 - (1 - short.ema) * short.steps / steps
    shorter = replace(short, steps=steps, ema=ema)
    return {
        "paper": replace(paper, steps=seen // paper.batch),
        "short": shorter,
        "short, constant rate": replace(shorter, schedule="constant"),
    }


def main(
    out: Positional[Path],
    network: str = "tiny",
    seen: int = 12_800,
    epoch: int = 1_000,
    held_out: int = 192,
    seeds: int = 3,
    threads: int = 1,
) -> None:
    """Print a row for each recipe, with each seed's figures.

    Args:
        out: folder of the runs.
        network: preset.
        seen: pairs that each training sees, with repetitions.
        epoch: distinct pairs among them.
        held_out: pairs of other shapes to judge by.
        seeds: trainings of each recipe.
        threads: of the network's arithmetic.
    """
    torch.set_num_threads(threads)
    config = preset(network)
    rows: dict[str, list[dict[str, float]]] = {}
    for seed in range(seeds):
        pairs, others = make_pair_sets(config, seed, epoch, seen, held_out)
        others = [others[i] for i in range(held_out)]
        for name, recipe in recipes(seen).items():
            folder = out / f"{name.replace(', ', '-').replace(' ', '-')}-seed{seed}"
            for row, scores in run(folder, config, recipe, seed, pairs, others).items():
                rows.setdefault(f"{name}{row}", []).append(scores)
        print(table(rows), flush=True)


def run(
    folder: Path,
    network: NetworkConfig,
    recipe: Recipe,
    seed: int,
    pairs: Dataset[PairBatch],
    others: list[PairBatch],
) -> dict[str, dict[str, float]]:
    """Scores of the weights, and of their running mean where the recipe keeps one."""
    path = folder / "scores.json"
    if not path.is_file():
        config = TrainConfig(network, recipe, seed=seed, validate_every=recipe.steps)
        average = train(config, pairs, others[:16], folder)
        last = Robust6DofNet(network)
        checkpoint = next((folder / "checkpoint").glob("step_*"))
        last.load_state_dict(load_file(checkpoint / "network.safetensors"))
        nets = {"": average, ", last weights": last} if recipe.ema else {"": last}
        scores = {name: validate(net, _batches(others)) for name, net in nets.items()}
        path.write_text(json.dumps(scores, indent=1))
    return json.loads(path.read_text())


def _batches(pairs: list[PairBatch]):
    return DataLoader(pairs, batch_size=16, collate_fn=collate)


def table(rows: dict[str, list[dict[str, float]]]) -> str:
    """Mean over the seeds, and each seed's figure in brackets."""
    lines = ["| recipe | " + " | ".join(COLUMNS) + " |", "|---" * (len(COLUMNS) + 1) + "|"]
    for name, scores in rows.items():
        cells = []
        for column in COLUMNS:
            values = [one[column] for one in scores]
            each = ", ".join(f"{value:.1f}" for value in values)
            cells.append(f"{np.mean(values):.1f} ({each})")
        lines.append(f"| {name} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


if __name__ == "__main__":
    tyro.cli(main)
