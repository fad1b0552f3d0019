"""The training loop: one plain function, resumable at any moment, alone or under torchrun."""

from __future__ import annotations

import copy
import json
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import torch
from torch import nn
from torch.nn.parallel import DistributedDataParallel
from torch.utils.data import DataLoader, Dataset, Subset

from robust6dof.errors import DataError
from robust6dof.network.checkpoint import save_network
from robust6dof.network.config import NetworkConfig
from robust6dof.network.robust6dof_net import Robust6DofNet
from robust6dof.training.checkpoints import load_checkpoint, save_checkpoint
from robust6dof.training.losses import LossConfig, pair_losses
from robust6dof.training.pair_batch import PairBatch, collate
from robust6dof.training.precision import Precision, answer
from robust6dof.training.processes import Processes
from robust6dof.training.recipe import Recipe
from robust6dof.training.train_log import TrainLog
from robust6dof.training.validation import validate


@dataclass(frozen=True)
class TrainConfig:
    """All that determines a training run."""

    network: NetworkConfig
    recipe: Recipe = field(default_factory=Recipe)
    losses: LossConfig = field(default_factory=LossConfig)
    seed: int = 0
    data: dict[str, Any] = field(default_factory=dict)
    """What the pairs are made of, as JSON: a run is taken up again with the same alone."""
    precision: Precision = "auto"
    """Of the network's arithmetic; auto is bf16, mixed with 32 bits, on CUDA."""
    workers: int = 0
    """Processes that make the pairs; 0 makes them in the training process."""
    log_every: int = 20
    save_every: int = 250
    validate_every: int = 500


def train(
    config: TrainConfig,
    pairs: Dataset[PairBatch],
    held_out: Dataset[PairBatch] | None,
    out: Path,
    *,
    init: Robust6DofNet | None = None,
    device: str = "cpu",
    stop: Callable[[], bool] = lambda: False,
) -> Robust6DofNet:
    """Train, or go on where a killed run stopped; returns the averaged network.

    Writes `out/checkpoint/`, `out/log.jsonl` (losses and validation by step), `out/network.*`.
    Step s uses pairs s·batch to (s+1)·batch − 1, so a resumed run sees the same pairs.

    Args:
        config: see its fields.
        pairs: indexed training pairs, at least recipe.steps · recipe.batch of them.
        held_out: pairs of other shapes or recordings, for validation; none validates nothing.
        out: folder of results.
        init: weights to start from.
        device: of the network.
        stop: asked after every step; True ends the run as an interrupt would.

    Raises:
        DataError: `out` holds another configuration's run.
        InputError: a batch that the processes cannot share evenly.
    """
    processes = Processes.join(device)
    leads, device = processes.rank == 0, processes.device
    if leads:
        _claim_folder(config, out)
    torch.manual_seed(config.seed)
    net = (init or Robust6DofNet(config.network)).to(device).train()
    average = copy.deepcopy(net).eval()
    optimizer = torch.optim.Adam(net.parameters(), lr=config.recipe.learning_rate)
    first = load_checkpoint(out / "checkpoint", net, average, optimizer)
    if processes.of_first(first) != first:
        raise DataError(out, "the processes found different checkpoints", "Use a folder all share")
    several = processes.count > 1
    wrapped = DistributedDataParallel(net, find_unused_parameters=True) if several else net
    log = TrainLog(out, first, config.recipe.steps, quiet=not leads)
    for step, batch in enumerate(_batches(config, pairs, first, processes), start=first):
        parts = _step(wrapped, average, optimizer, batch.to(device), config, step)
        done = step + 1
        last = bool(processes.of_first(done == config.recipe.steps or stop()))
        if leads:
            log.losses(done, parts, config.log_every)
        if leads and held_out is not None and (last or done % config.validate_every == 0):
            log.scores(done, validate(average, _held_out_batches(held_out, device)))
        if leads and (last or done % config.save_every == 0):
            save_checkpoint(out / "checkpoint", done, net, average, optimizer)
            save_network(average, out / "network")
        if last:
            break
    log.close()
    processes.leave()
    return average


def _step(
    net: nn.Module,
    average: Robust6DofNet,
    optimizer: torch.optim.Optimizer,
    batch: PairBatch,
    config: TrainConfig,
    step: int,
) -> dict[str, float]:
    """One step of the optimiser; returns the losses."""
    recipe = config.recipe
    for group in optimizer.param_groups:
        group["lr"] = recipe.rate(step)
    output = answer(net, batch, config.precision)
    loss, parts = pair_losses(output, batch.truth, config.losses)
    optimizer.zero_grad(set_to_none=True)
    loss.backward()
    norm = nn.utils.clip_grad_norm_(net.parameters(), recipe.clip or torch.inf)
    if bool(torch.isfinite(norm)):
        optimizer.step()
        _update_average(average, net, recipe.ema)
    values = {"loss": loss, "gradient": norm} | parts
    return {name: float(value.detach()) for name, value in values.items()}


@torch.no_grad()
def _update_average(average: nn.Module, net: nn.Module, decay: float) -> None:
    plain = net.module if isinstance(net, DistributedDataParallel) else net
    for mean, value in zip(average.state_dict().values(), plain.state_dict().values(), strict=True):
        if mean.dtype.is_floating_point:
            mean.lerp_(value, 1.0 - decay)
        else:
            mean.copy_(value)


def _batches(
    config: TrainConfig, pairs: Dataset[PairBatch], first: int, processes: Processes
) -> Iterator[PairBatch]:
    """This process's share of every batch, from step `first` on."""
    size = config.recipe.batch
    share = processes.share(size)
    indices = [
        step * size + processes.rank * share + i
        for step in range(first, config.recipe.steps)
        for i in range(share)
    ]
    loader = DataLoader(
        Subset(pairs, indices),
        batch_size=share,
        collate_fn=collate,
        num_workers=config.workers,
        worker_init_fn=_single_thread,
        prefetch_factor=4 if config.workers else None,
    )
    return iter(loader)


def _held_out_batches(held_out: Dataset[PairBatch], device: str) -> Iterator[PairBatch]:
    loader = DataLoader(held_out, batch_size=16, collate_fn=collate)
    return (batch.to(device) for batch in loader)


def _single_thread(worker: int) -> None:
    torch.set_num_threads(1)


def _claim_folder(config: TrainConfig, out: Path) -> None:
    """Write the configuration, or check that the folder's is the same."""
    mine: dict[str, Any] = json.loads(json.dumps(asdict(config)))
    for runtime in ("workers", "log_every", "save_every", "validate_every"):
        mine.pop(runtime)
    path = out / "config.json"
    if path.exists():
        there = json.loads(path.read_text())
        other = sorted(key for key in mine | there if mine.get(key) != there.get(key))
        if other:
            problem = f"another configuration trains here: its {', '.join(other)} differ"
            raise DataError(path, problem, "Choose another --out, or remove it")
    out.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(mine, indent=2))
