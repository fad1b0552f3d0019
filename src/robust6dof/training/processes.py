"""Several processes that train one network together, as torchrun starts them; or one alone."""

from __future__ import annotations

import os
from dataclasses import dataclass

import torch
import torch.distributed as dist

from robust6dof.errors import InputError


@dataclass(frozen=True)
class Processes:
    """This process among those that train together."""

    rank: int
    count: int
    device: str
    """Of this process's network: with CUDA each has a GPU of its own."""

    @staticmethod
    def join(device: str) -> Processes:
        """Meet the others; alone where torchrun started none (its WORLD_SIZE is not set)."""
        count = int(os.environ.get("WORLD_SIZE", "1"))
        if count == 1:
            return Processes(0, 1, device)
        if device == "cuda":
            device = f"cuda:{os.environ.get('LOCAL_RANK', '0')}"
            torch.cuda.set_device(device)
        if not dist.is_initialized():
            dist.init_process_group("nccl" if device.startswith("cuda") else "gloo")
        return Processes(dist.get_rank(), count, device)

    def share(self, batch: int) -> int:
        """This process's part of a batch.

        Raises:
            InputError: the batch cannot be shared out evenly.
        """
        if batch % self.count:
            raise InputError(f"a batch of {batch} cannot be shared by {self.count} processes")
        return batch // self.count

    def of_first(self, value: int) -> int:
        """What the first process says, so that all do the same; waits for it."""
        if self.count == 1:
            return value
        said = torch.tensor([value], device=self.device)
        dist.broadcast(said, src=0)
        return int(said.item())

    def leave(self) -> None:
        """Part from the others, once all are done; one that left early was seen to hang."""
        if self.count > 1:
            dist.barrier()
            dist.destroy_process_group()
