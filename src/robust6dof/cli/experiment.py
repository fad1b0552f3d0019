"""Make a table and a figure of the paper on whatever data is at hand; run again to go on.

Names: estimation, tracking, ycb-video, ycbineoat, wild6d, speed, dropped-frames, pose-noise,
keypoint-count, component-ablation, keypoint-ablation, loss-ablation, qualitative; beyond the paper
losses, calibration, drift; or all.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from robust6dof.cli.options import CommonOptions

if TYPE_CHECKING:
    from robust6dof.experiments.setting import Setting


@dataclass(frozen=True, kw_only=True)
class Options(CommonOptions):
    name: Annotated[str, tyro.conf.Positional]
    """Which experiment; `all` makes every one."""
    data: Annotated[Path | None, tyro.conf.Positional] = None
    """A data set with ground truth; without it a small synthetic one is made."""
    out: Path = Path("experiments")
    """Folder of the experiments; each has a folder of its own in it."""
    tracker: str | None = None
    """Which tracker (default: robust6dof with the shipped weights, or icp where none are)."""
    baselines: tuple[str, ...] = ("icp", "features", "static")
    """Trackers to stand beside."""
    weights: Path | None = None
    """Weights (.safetensors) of the network's trackers, instead of the shipped ones."""
    size: Literal["tiny", "small", "full"] = "small"
    """tiny: does it run; small: minutes to an hour on two cores; full: everything."""
    frames: int | None = None
    """Use at most so many frames of each sequence, instead of the size's."""
    network: Literal["paper", "small", "tiny"] | None = None
    """Preset of the network that the ablations train, instead of the size's."""
    steps: int | None = None
    """Training steps of each row of an ablation, instead of the size's."""
    trainings: int = 1
    """How often each row of an ablation is trained, with seeds from --seed on."""
    models: Path | None = None
    """Model points for ADD and ADD-S (default: models_points or models in the data set)."""
    meshes: Path | None = None
    """Meshes that recordings were made with (--meshes of synthesize): ADD and ADD-S are measured
    on them where there are no model points, and oracle-icp is given them."""
    processes: int = 1
    """Sequences followed at the same time."""


def run(options: Options) -> None:
    """Run one experiment or all, and print each table."""
    from robust6dof.experiments.registry import EXPERIMENTS, find_experiment
    from robust6dof.experiments.report import markdown, write

    for name in EXPERIMENTS if options.name == "all" else (options.name,):
        experiment = find_experiment(name)
        setting = _setting(options, options.out / name)
        report = experiment.run(setting)
        write(report, setting.out)
        print(markdown(report, setting.out))
        print(f"written: {setting.out / 'table.md'}")


def _setting(options: Options, out: Path) -> Setting:
    from robust6dof.experiments.setting import SIZES, Setting

    size = SIZES[options.size]
    return Setting(
        out=out,
        data=options.data,
        tracker=options.tracker or _default_tracker(options),
        baselines=options.baselines,
        size=replace(size, frames=options.frames or size.frames),
        weights=options.weights,
        device=options.device,
        seed=options.seed,
        processes=options.processes,
        network=options.network,
        steps=options.steps,
        trainings=options.trainings,
        models=options.models,
        meshes=options.meshes,
    )


def _default_tracker(options: Options) -> str:
    from robust6dof.tracking.pretrained import shipped_weights

    if options.weights or shipped_weights():
        return "robust6dof"
    print("note: no weights are shipped; the tracker in question is icp")
    return "icp"
