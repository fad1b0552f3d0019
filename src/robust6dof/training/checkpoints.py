"""Checkpoints that survive a kill at any moment: safetensors and JSON, whole or not at all."""

from __future__ import annotations

import json
import os
import shutil
from pathlib import Path

import torch
from safetensors.torch import load_file, save_file
from torch import Tensor, nn

from robust6dof.errors import DataError

_POINTER = "latest.json"


def save_checkpoint(
    folder: Path, step: int, net: nn.Module, ema: nn.Module, optimizer: torch.optim.Optimizer
) -> None:
    """Write `step_N/` and then point `latest.json` at it; older ones are removed."""
    folder.mkdir(parents=True, exist_ok=True)
    new = folder / f"step_{step:07d}"
    shutil.rmtree(new, ignore_errors=True)
    new.mkdir()
    save_file(_contiguous(net.state_dict()), new / "network.safetensors")
    save_file(_contiguous(ema.state_dict()), new / "ema.safetensors")
    save_file(_optimizer_tensors(optimizer), new / "optimizer.safetensors")
    pointer = folder / (_POINTER + ".new")
    pointer.write_text(json.dumps({"step": step, "folder": new.name}))
    os.replace(pointer, folder / _POINTER)
    for old in folder.glob("step_*"):
        if old != new:
            shutil.rmtree(old, ignore_errors=True)


def load_checkpoint(
    folder: Path, net: nn.Module, ema: nn.Module, optimizer: torch.optim.Optimizer
) -> int:
    """Restore the latest checkpoint into the given objects; returns its step, 0 if none.

    Raises:
        DataError: it belongs to another network.
    """
    pointer = folder / _POINTER
    if not pointer.exists():
        return 0
    latest = json.loads(pointer.read_text())
    source = folder / latest["folder"]
    try:
        net.load_state_dict(load_file(source / "network.safetensors"))
        ema.load_state_dict(load_file(source / "ema.safetensors"))
    except RuntimeError as error:
        raise DataError(
            source, "the checkpoint is of another network", "Choose another --out, or remove it"
        ) from error
    _restore_optimizer(optimizer, load_file(source / "optimizer.safetensors"))
    return int(latest["step"])


def _contiguous(state: dict[str, Tensor]) -> dict[str, Tensor]:
    return {name: value.detach().cpu().contiguous().clone() for name, value in state.items()}


def _optimizer_tensors(optimizer: torch.optim.Optimizer) -> dict[str, Tensor]:
    state = optimizer.state_dict()["state"]
    return {
        f"{index}.{name}": value.detach().cpu().contiguous().clone()
        for index, values in state.items()
        for name, value in values.items()
    }


def _restore_optimizer(optimizer: torch.optim.Optimizer, tensors: dict[str, Tensor]) -> None:
    state: dict[int, dict[str, Tensor]] = {}
    for key, value in tensors.items():
        index, name = key.split(".", 1)
        state.setdefault(int(index), {})[name] = value
    whole = optimizer.state_dict()
    whole["state"] = state
    optimizer.load_state_dict(whole)
