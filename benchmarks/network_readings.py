"""Train one small network under each reading of the paper, on the same pairs, and compare them.

Every row differs from the default in one setting; every row sees the same pairs in the same order.
Rows are compared at a small budget: they show which readings learn, not what they converge to.

    python benchmarks/network_readings.py --steps 300 --seeds 0 1 --out readings.json
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import torch
from torch.utils.data import DataLoader, Dataset

from robust6dof.network.config import NetworkConfig, preset
from robust6dof.network.robust6dof_net import Robust6DofNet
from robust6dof.training.loop import TrainConfig, train
from robust6dof.training.losses import LossConfig, pair_losses
from robust6dof.training.pair_batch import PairBatch, collate
from robust6dof.training.pair_sets import make_pair_sets
from robust6dof.training.recipe import Recipe
from robust6dof.training.validation import validate

NETWORK = replace(
    preset("small"),
    points=128,
    prior_points=128,
    keypoints=32,
    width=64,
    rank=16,
    plane_width=16,
    crop_px=64,
    pixel_widths=(16, 24, 32),
)
READINGS: dict[str, tuple[NetworkConfig, LossConfig]] = {
    "default": (NETWORK, LossConfig()),
    "auxiliary=literal": (NETWORK, LossConfig(auxiliary="literal", auxiliary_in_view=False)),
    "auxiliary over the whole prior": (NETWORK, LossConfig(auxiliary_in_view=False)),
    "auxiliary over the whole prior, moves correspondence": (
        NETWORK,
        LossConfig(auxiliary_in_view=False, auxiliary_moves_correspondence=True),
    ),
    "auxiliary=off": (NETWORK, LossConfig(auxiliary="off")),
    "translation=printed": (NETWORK, LossConfig(translation="printed")),
    "translation=exact": (NETWORK, LossConfig(translation="exact")),
    "shape_filter=max": (replace(NETWORK, shape_filter="max"), LossConfig()),
    "keypoint_source=learned": (replace(NETWORK, keypoint_source="learned"), LossConfig()),
    "fusion_residual=False": (replace(NETWORK, fusion_residual=False), LossConfig()),
    "contraction=printed": (replace(NETWORK, contraction="printed"), LossConfig()),
    "similarity=printed": (replace(NETWORK, similarity="printed"), LossConfig()),
    "dense_fusion=shared": (replace(NETWORK, dense_fusion="shared"), LossConfig()),
    "pixel_stem=rgb": (replace(NETWORK, pixel_stem="rgb"), LossConfig()),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--steps", type=int, default=300)
    parser.add_argument("--batch", type=int, default=8)
    parser.add_argument("--pairs", type=int, default=480, help="distinct pairs to train on")
    parser.add_argument("--held-out", type=int, default=96, help="pairs of other shapes")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0])
    parser.add_argument("--only", nargs="+", default=list(READINGS), choices=list(READINGS))
    parser.add_argument("--out", type=Path, required=True, help="taken up again where it exists")
    options = parser.parse_args()
    done = json.loads(options.out.read_text()) if options.out.exists() else {}
    count = options.steps * options.batch
    pairs, others = make_pair_sets(NETWORK, 0, options.pairs, count, options.held_out)
    held_out = list(DataLoader(others, batch_size=16, collate_fn=collate))
    for seed in options.seeds:
        for name in options.only:
            key = f"{name}/{seed}"
            if key in done:
                continue
            net = train_reading(name, seed, options.steps, options.batch, pairs)
            done[key] = score(net, held_out)
            print(key, {k: round(v, 4) for k, v in done[key].items()}, flush=True)
            options.out.write_text(json.dumps(done, indent=1))


def train_reading(
    name: str, seed: int, steps: int, batch: int, pairs: Dataset[PairBatch]
) -> Robust6DofNet:
    """A network of this reading after one pass over the pairs."""
    network, losses = READINGS[name]
    recipe = Recipe(learning_rate=2e-3, batch=batch, steps=steps, schedule="cosine", clip=1.0)
    config = TrainConfig(network, recipe, losses, seed)
    with TemporaryDirectory() as folder:
        return train(config, pairs, None, Path(folder))


@torch.no_grad()
def score(net: Robust6DofNet, held_out: Sequence[PairBatch]) -> dict[str, float]:
    """Median errors of step and anchor; mean errors of coordinates and keypoints, in diagonals."""
    scores = validate(net, held_out)
    parts = []
    for batch in held_out:
        output = net.eval()(batch.previous, batch.current, batch.prior)
        parts.append(pair_losses(output, batch.truth, LossConfig())[1])
    for name in ("anchor", "correspondence", "consistency", "auxiliary", "matching"):
        scores[f"loss_{name}"] = float(torch.stack([part[name] for part in parts]).mean())
    return scores


if __name__ == "__main__":
    main()
