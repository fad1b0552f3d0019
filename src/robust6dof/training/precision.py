"""The network in mixed precision, its answer in 32 bits."""

from __future__ import annotations

from dataclasses import fields
from typing import Any, Literal

import torch
from torch import Tensor, nn

from robust6dof.network.robust6dof_net import PairOutput
from robust6dof.training.pair_batch import PairBatch

Precision = Literal["auto", "bf16", "fp32"]


def answer(net: nn.Module, batch: PairBatch, precision: Precision) -> PairOutput:
    """What the network says of a batch, for the losses.

    Args:
        net: its weights stay in 32 bits.
        batch: the pairs.
        precision: bf16 computes in bfloat16 where PyTorch holds it to be safe; auto does so on
            CUDA.
    """
    device = batch.prior.device.type
    mixed = precision == "bf16" or (precision == "auto" and device == "cuda")
    with torch.autocast(device, torch.bfloat16, enabled=mixed):
        output: PairOutput = net(batch.previous, batch.current, batch.prior)
    return _in_32_bits(output) if mixed else output


def _in_32_bits(part: Any) -> Any:
    """A tensor, or a dataclass of such, at whatever depth."""
    if isinstance(part, Tensor):
        return part.float()
    names = [field.name for field in fields(part)]
    return type(part)(**{name: _in_32_bits(getattr(part, name)) for name in names})
