"""Measure speed: the network alone, with the distance to the floor; or a tracker end to end."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro.conf

from robust6dof.cli.options import CommonOptions


@dataclass(frozen=True, kw_only=True)
class Options(CommonOptions):
    what: Annotated[Literal["network", "track"], tyro.conf.Positional]
    """What to measure."""
    preset: Literal["paper", "small", "tiny"] | None = None
    """A network of this size with random weights; `network` takes small where none is named."""
    weights: Path | None = None
    """Weights for `track` (.safetensors), instead of the shipped ones or a --preset."""
    category: str = "mug"
    """Of the object that `track` follows."""
    frames: int = 60
    """Of the recording that `track` follows; it is rendered first."""
    threads: int = 2
    """Threads of torch on the CPU."""
    repeats: int = 50
    """Steps that `network` times."""
    json: Path | None = None
    """Write the result here."""


def run(options: Options) -> None:
    """Measure, print, write."""
    import json
    from dataclasses import asdict

    import torch

    torch.set_num_threads(options.threads)
    measured = _network(options) if options.what == "network" else _track(options)
    text = json.dumps(asdict(measured), indent=2)
    print(text)
    if options.json is not None:
        options.json.parent.mkdir(parents=True, exist_ok=True)
        options.json.write_text(text + "\n")


def _network(options: Options):
    from robust6dof.network.benchmark import benchmark_network
    from robust6dof.network.config import preset
    from robust6dof.network.device import resolve_device

    device = resolve_device(options.device)
    name = options.preset or "small"
    return benchmark_network(preset(name), name, device, options.seed, options.repeats)


def _track(options: Options):
    import torch

    from robust6dof.evaluation.track_benchmark import benchmark_track
    from robust6dof.network.config import preset
    from robust6dof.network.device import resolve_device
    from robust6dof.network.robust6dof_net import Robust6DofNet
    from robust6dof.shapes.priors import load_prior
    from robust6dof.tracking.encoder import ViewEncoder
    from robust6dof.tracking.pretrained import load_pretrained

    device = resolve_device(options.device)
    torch.manual_seed(options.seed)
    if options.preset and not options.weights:
        net = Robust6DofNet(preset(options.preset)).to(device)
    else:
        net = load_pretrained(options.weights, device)
    encoder = ViewEncoder(net, load_prior(options.category), options.category, options.seed)
    return benchmark_track(encoder, options.frames, options.seed)
