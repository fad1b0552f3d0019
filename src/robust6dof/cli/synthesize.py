"""Make synthetic recordings with ground truth: aerial motion over tables with everyday objects."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from robust6dof.cli.options import CommonOptions

if TYPE_CHECKING:
    from robust6dof.synthetic.plans import SequencePlan


@dataclass(frozen=True, kw_only=True)
class Options(CommonOptions):
    world: Annotated[Literal["aerial"], tyro.conf.Positional]
    """What to make."""
    out: Path
    """Folder of the recordings; whole ones that are there already are kept."""
    split: Literal["mini", "full"] | None = None
    """A split of AerialPose-Sim; seed, sequences, frames, difficulty and categories are its own."""
    sequences: int = 18
    """How many; they go through categories and difficulties in turn."""
    frames: int = 120
    """In each recording, at 30 Hz."""
    difficulty: tuple[Literal["calm", "agile", "harsh", "leaving"], ...] = (
        "calm",
        "agile",
        "harsh",
    )
    """One or several; in `leaving` the object is out of view again and again."""
    categories: tuple[str, ...] = ("bottle", "bowl", "camera", "can", "laptop", "mug")
    """Of the targets; with --meshes any name of a folder there."""
    meshes: Path | None = None
    """Folder with CATEGORY/MESH files: targets from there, not procedural shapes."""
    first: int = 0
    """Number of the first recording to make, to share them out over machines or jobs."""
    last: int | None = None
    """Number of the last one to make."""
    gyro: bool = False
    """Write what the camera's gyro measures, too (`gyro.csv`); trackers use it where it is."""
    processes: int = 1
    """Recordings made at the same time."""


def run(options: Options) -> None:
    """Make what is not there yet."""
    from functools import partial

    from robust6dof.cli.make_all import make_all
    from robust6dof.synthetic.aerial import synthesize

    plans = _plans(options)
    last = len(plans) - 1 if options.last is None else options.last
    mine = plans[options.first : last + 1]
    options.out.mkdir(parents=True, exist_ok=True)
    make_all(
        partial(synthesize, out=options.out, gyro=options.gyro),
        mine,
        options.processes,
        "recordings",
    )
    print(f"{len(mine)} recordings: {options.out}")


def _plans(options: Options) -> list[SequencePlan]:
    from robust6dof.errors import InputError
    from robust6dof.synthetic.plans import plan_aerial, plan_split

    if options.split is None:
        return plan_aerial(
            options.seed,
            options.sequences,
            options.frames,
            options.difficulty,
            options.categories,
            options.meshes,
        )
    own = Options(world="aerial", out=options.out)
    for name in ("seed", "sequences", "frames", "difficulty", "categories"):
        if getattr(options, name) != getattr(own, name):
            raise InputError(f"--{name} is the split's own: leave out --{name} or --split")
    return plan_split(options.split, options.meshes)
