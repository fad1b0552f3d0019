"""A training pair: two views of one object and their truth; several of them are a batch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from robust6dof.network.inputs import ViewBatch
from robust6dof.training.targets import PairTruth


@dataclass(frozen=True, eq=False)
class PairBatch:
    """B training pairs."""

    previous: ViewBatch
    current: ViewBatch
    prior: Float[Tensor, "B Nr 3"]
    truth: PairTruth

    def to(self, device: torch.device | str) -> PairBatch:
        """The same on another device."""
        return PairBatch(
            self.previous.to(device),
            self.current.to(device),
            self.prior.to(device),
            self.truth.to(device),
        )


def collate(pairs: Sequence[PairBatch]) -> PairBatch:
    """Several pairs as one batch."""
    truths = [pair.truth for pair in pairs]
    truth = {f.name: torch.cat([getattr(t, f.name) for t in truths]) for f in fields(PairTruth)}
    return PairBatch(
        ViewBatch.cat([pair.previous for pair in pairs]),
        ViewBatch.cat([pair.current for pair in pairs]),
        torch.cat([pair.prior for pair in pairs]),
        PairTruth(**truth),
    )


def batch_of_one(values: np.ndarray) -> Tensor:
    """As float32 with a leading axis of one."""
    return torch.from_numpy(np.asarray(values, dtype=np.float32))[None]
