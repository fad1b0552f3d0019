"""Run a tracker over a data set and store its poses; `robust6dof evaluate` scores them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from robust6dof.cli.evaluate import ProtocolName
from robust6dof.cli.options import CommonOptions


@dataclass(frozen=True, kw_only=True)
class Options(CommonOptions):
    data: Annotated[Path, tyro.conf.Positional]
    """A data set, a folder of recordings or one recording, with ground truth."""
    tracker: str
    """Which tracker; an unknown name lists what there is."""
    protocol: ProtocolName
    """How the tracker is started."""
    out: Path
    """Folder of the run; a run that was cut short goes on where it stopped."""
    weights: Path | None = None
    """Weights (.safetensors) of the network's trackers (default: the shipped ones)."""
    meshes: Path | None = None
    """CAD meshes for oracle-icp, in the data set's object frames (default: models/ or meshes/ in
    the data set)."""
    sequences: tuple[str, ...] = ()
    """Only these (default: all)."""
    shard: str = "0/1"
    """Part i of n, as i/n with i from 0: how a job array shares a data set out over machines that
    write to one folder."""
    processes: int = 1
    """Sequences followed at the same time."""
    every: int = 1
    """Show the tracker each n-th frame only, and score it on these."""
    most: int | None = None
    """Use at most so many frames of each sequence."""
    drop: int = 0
    """Leave out so many frames after each sequence's first."""
    init_noise: float = 0.0
    """The paper's Init×n: further noise on the first pose, n times CAPTRA's."""
    all_noise: float = 0.0
    """The paper's All×n: such noise on every pose that the tracker steps from."""
    single_view: bool = False
    """Estimate each frame by itself from its mask alone, instead of tracking."""


def run(options: Options) -> None:
    """Follow everything, saying which sequence is done."""
    from functools import partial

    from robust6dof.baselines.registry import make_tracker
    from robust6dof.evaluation.predict import predict
    from robust6dof.evaluation.run_info import RunInfo

    info = RunInfo.of_named(
        options.tracker,
        options.protocol,
        options.data,
        options.seed,
        options.weights,
        options.meshes,
        every=options.every,
        drop=options.drop,
        most=options.most,
        init_noise=options.init_noise,
        all_noise=options.all_noise,
        single_view=options.single_view,
    )
    make = partial(
        make_tracker,
        options.tracker,
        seed=options.seed,
        weights=options.weights,
        device=options.device,
    )
    if info.remark:
        print(f"note: {info.remark}")
    shard = _shard(options.shard)
    for name in predict(make, info, options.out, options.sequences, options.processes, shard):
        print(f"{name}: done", flush=True)
    print(f"written: {options.out}")


def _shard(text: str) -> tuple[int, int]:
    """(i, n) of "i/n"."""
    from robust6dof.errors import InputError

    part, _, count = text.partition("/")
    if not (part.isdecimal() and count.isdecimal() and int(part) < int(count)):
        raise InputError(f"'{text}' does not read --shard i/n with i from 0 to n − 1")
    return int(part), int(count)
