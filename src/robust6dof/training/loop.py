"""The training loop: one plain function, resumable at any moment, alone or under torchrun."""

from __future__ import annotations

import copy
import json
import os
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path

import torch
import torch.distributed as dist
from torch import nn
from torch.nn.parallel import DistributedDataParallel
from torch.utils.data import DataLoader, Dataset, Subset
from tqdm import tqdm

from robust6dof.errors import DataError
from robust6dof.network.checkpoint import save_network
from robust6dof.network.config import NetworkConfig
from robust6dof.network.robust6dof_net import PairOutput, Robust6DofNet
from robust6dof.training.checkpoints import load_checkpoint, save_checkpoint
from robust6dof.training.losses import LossConfig, pair_losses
from robust6dof.training.pair_batch import PairBatch, collate
from robust6dof.training.recipe import Recipe
from robust6dof.training.validation import validate


@dataclass(frozen=True)
class TrainConfig:
    """All that determines a training run beside its data."""

    network: NetworkConfig
    recipe: Recipe = field(default_factory=Recipe)
    losses: LossConfig = field(default_factory=LossConfig)
    seed: int = 0
    workers: int = 0
    """Processes that make the pairs; 0 makes them in the training process."""
    log_every: int = 20
    save_every: int = 250
    validate_every: int = 500


def train(
    config: TrainConfig,
    pairs: Dataset[PairBatch],
    held_out: Dataset[PairBatch],
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
        held_out: pairs of other shapes, for validation.
        out: folder of results.
        init: weights to start from.
        device: of the network.
        stop: asked after every step; True ends the run as an interrupt would.

    Raises:
        DataError: `out` holds another configuration's run.
    """
    rank, world = _join_processes(device)
    _claim_folder(config, out, rank)
    torch.manual_seed(config.seed)
    net = (init or Robust6DofNet(config.network)).to(device).train()
    average = copy.deepcopy(net).eval()
    optimizer = torch.optim.Adam(net.parameters(), lr=config.recipe.learning_rate)
    first = load_checkpoint(out / "checkpoint", net, average, optimizer)
    wrapped = DistributedDataParallel(net, find_unused_parameters=True) if world > 1 else net
    batches = _batches(config, pairs, first, rank, world)
    log = _Log(out, first, config.recipe.steps, quiet=rank > 0)
    for step, batch in enumerate(batches, start=first):
        parts = _step(wrapped, average, optimizer, batch.to(device), config, step)
        done = step + 1
        if rank == 0:
            log.losses(done, parts, config.log_every)
        last = done == config.recipe.steps or stop()
        if rank == 0 and (last or done % config.validate_every == 0):
            log.scores(done, validate(average, _held_out_batches(held_out, device)))
        if rank == 0 and (last or done % config.save_every == 0):
            save_checkpoint(out / "checkpoint", done, net, average, optimizer)
            save_network(average, out / "network")
        if last:
            break
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
    cuda = batch.prior.device.type == "cuda"
    with torch.autocast("cuda", torch.bfloat16, enabled=cuda):
        output: PairOutput = net(batch.previous, batch.current, batch.prior)
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
    config: TrainConfig, pairs: Dataset[PairBatch], first: int, rank: int, world: int
) -> Iterator[PairBatch]:
    """This process's share of every batch, from step `first` on."""
    size = config.recipe.batch
    share = size // world
    indices = [
        step * size + rank * share + i
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


def _join_processes(device: str) -> tuple[int, int]:
    """Rank and number of processes, as torchrun set them; 0 and 1 alone."""
    world = int(os.environ.get("WORLD_SIZE", "1"))
    if world > 1 and not dist.is_initialized():
        dist.init_process_group("nccl" if device.startswith("cuda") else "gloo")
    return (dist.get_rank() if world > 1 else 0), world


def _claim_folder(config: TrainConfig, out: Path, rank: int) -> None:
    """Write the configuration, or check that the folder's is the same."""
    mine = json.loads(json.dumps(asdict(config)))
    for runtime in ("workers", "log_every", "save_every", "validate_every"):
        mine.pop(runtime)
    path = out / "config.json"
    if path.exists() and json.loads(path.read_text()) != mine:
        raise DataError(path, "another configuration trains here", "Choose another --out")
    if rank == 0:
        out.mkdir(parents=True, exist_ok=True)
        path.write_text(json.dumps(mine, indent=2))


class _Log:
    """Progress on screen, `log.jsonl`, and TensorBoard where it is installed."""

    def __init__(self, out: Path, first: int, steps: int, quiet: bool) -> None:
        self._path = out / "log.jsonl"
        self._bar = tqdm(total=steps, initial=first, disable=quiet, unit="step", mininterval=5)
        self._start = time.monotonic()
        self._board = None if quiet else _tensorboard(out)

    def losses(self, step: int, parts: dict[str, float], every: int) -> None:
        self._bar.update(1)
        if step % every == 0:
            self._bar.set_postfix(loss=f"{parts['loss']:.3f}")
            self._write(step, parts)

    def scores(self, step: int, scores: dict[str, float]) -> None:
        self._bar.write(
            f"step {step}: 5°5cm {scores['anchor_5deg5cm']:.1f} % from one view "
            f"({scores['anchor_deg']:.1f}°, {scores['anchor_cm']:.1f} cm), "
            f"step {scores['step_5deg5cm']:.1f} % ({scores['step_deg']:.1f}°), "
            f"given {scores['start_5deg5cm']:.1f} %"
        )
        self._write(step, {f"validation/{name}": value for name, value in scores.items()})

    def _write(self, step: int, values: dict[str, float]) -> None:
        with self._path.open("a") as file:
            seconds = round(time.monotonic() - self._start, 1)
            file.write(json.dumps({"step": step, "seconds": seconds} | values) + "\n")
        if self._board is not None:
            for name, value in values.items():
                self._board.add_scalar(name, value, step)


def _tensorboard(out: Path):
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError:
        return None
    return SummaryWriter(str(out / "tensorboard"))
