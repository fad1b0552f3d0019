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

import torch

from robust6dof.network.config import NetworkConfig, preset
from robust6dof.network.robust6dof_net import Robust6DofNet
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
    held_out = [
        collate([others[i] for i in range(k, min(k + 16, len(others)))])
        for k in range(0, len(others), 16)
    ]
    for seed in options.seeds:
        for name in options.only:
            key = f"{name}/{seed}"
            if key in done:
                continue
            batches = (
                collate([pairs[i] for i in range(s * options.batch, (s + 1) * options.batch)])
                for s in range(options.steps)
            )
            done[key] = score(train(name, seed, batches, options.steps), held_out)
            print(key, {k: round(v, 4) for k, v in done[key].items()}, flush=True)
            options.out.write_text(json.dumps(done, indent=1))


def train(name: str, seed: int, batches, steps: int) -> Robust6DofNet:
    """A network of this reading after one pass over the batches: Adam, falling rate, clipping."""
    network, losses = READINGS[name]
    torch.manual_seed(seed)
    net = Robust6DofNet(network)
    optimizer = torch.optim.Adam(net.parameters(), 2e-3)
    recipe = Recipe(learning_rate=2e-3, steps=steps, schedule="cosine")
    for step, batch in enumerate(batches):
        for group in optimizer.param_groups:
            group["lr"] = recipe.rate(step)
        loss, _ = pair_losses(net(batch.previous, batch.current, batch.prior), batch.truth, losses)
        optimizer.zero_grad()
        loss.backward()
        torch.nn.utils.clip_grad_norm_(net.parameters(), 1.0)
        optimizer.step()
    return net.eval()


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
