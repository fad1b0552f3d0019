"""Measure speed: the network alone (parameters, time of each stage, distance to the floor)."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro.conf

from robust6dof.cli.options import CommonOptions


@dataclass(frozen=True, kw_only=True)
class Options(CommonOptions):
    what: Annotated[Literal["network"], tyro.conf.Positional]
    """What to measure."""
    preset: Literal["paper", "small", "tiny"] = "small"
    """Which network."""
    threads: int = 2
    """Threads of torch on the CPU."""
    repeats: int = 50
    """Steps that are timed."""
    json: Path | None = None
    """Write the result here."""


def run(options: Options) -> None:
    import json
    from dataclasses import asdict

    import torch

    from robust6dof.network.benchmark import benchmark_network
    from robust6dof.network.config import preset
    from robust6dof.network.device import resolve_device

    torch.set_num_threads(options.threads)
    result = asdict(
        benchmark_network(
            preset(options.preset),
            options.preset,
            resolve_device(options.device),
            options.seed,
            options.repeats,
        )
    )
    text = json.dumps(result, indent=2)
    print(text)
    if options.json is not None:
        options.json.parent.mkdir(parents=True, exist_ok=True)
        options.json.write_text(text + "\n")
