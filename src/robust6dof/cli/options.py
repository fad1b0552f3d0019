"""Options that every subcommand has."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True, kw_only=True)
class CommonOptions:
    seed: int = 0
    """Seed of everything random."""
    device: Literal["auto", "cpu", "cuda"] = "auto"
    """Where the network runs; auto takes CUDA where there is one."""
    debug: bool = False
    """Show the traceback of an error."""
