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
    sequences: tuple[str, ...] = ()
    """Only these, to share a data set out over machines (default: all)."""
    workers: int = 1
    """Sequences followed at the same time, each in a process of its own."""


def run(options: Options) -> None:
    """Follow everything, saying which sequence is done."""
    from functools import partial

    from robust6dof.baselines.registry import make_tracker
    from robust6dof.evaluation.predict import RunInfo, predict

    info = RunInfo(options.tracker, options.protocol, str(options.data.resolve()), options.seed)
    make = partial(make_tracker, options.tracker, seed=options.seed)
    for name in predict(make, info, options.out, options.sequences, options.workers):
        print(f"{name}: done", flush=True)
    print(f"written: {options.out}")
