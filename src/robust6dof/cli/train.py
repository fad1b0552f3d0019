"""Train the tracker's network, on the synthetic world or on recordings with poses and masks; run
again to go on where it stopped.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import tyro

from robust6dof.cli.options import CommonOptions

if TYPE_CHECKING:
    from torch.utils.data import Dataset

    from robust6dof.network.config import NetworkConfig
    from robust6dof.shapes.mesh import ObjectModel
    from robust6dof.training.pair_batch import PairBatch
    from robust6dof.training.pairs import PairConfig
    from robust6dof.training.prediction_errors import Replayed

    PairSets = tuple[Dataset[PairBatch], Dataset[PairBatch] | None]


@dataclass(frozen=True, kw_only=True)
class Options(CommonOptions):
    preset: Literal["paper", "small", "tiny"] = "small"
    """Size of the network."""
    data: Literal["aerial", "ycb-video", "nocs", "recordings"] = "aerial"
    """aerial: rendered objects of categories, standing. ycb-video: the 21 scans of YCB-Video,
    rendered standing and lying (--meshes), or its own videos (--from). nocs: its training splits
    (--from). recordings: any folder that `robust6dof doctor` knows, with poses and masks (--from).
    """
    source: Annotated[Path | None, tyro.conf.arg(name="from")] = None
    """Folder of the recordings or the data set to learn from; its layout is recognised."""
    models: Path | None = None
    """Object models of YCB-Video's videos, where they are not in its models/ folder."""
    gap: int = 8
    """Of recordings: how many frames the two views of a pair are apart at most."""
    replay: tuple[Path, ...] = ()
    """Runs of `robust6dof predict`: half of the pairs repeat the errors of these tracks."""
    categories: tuple[str, ...] = ()
    """Of the objects (default: the six, all 21, or all that is recorded); with --meshes any name
    of a folder there that has a prior."""
    meshes: Path | None = None
    """Folder with CATEGORY/MESH files: objects from there, not procedural shapes. For ycb-video the
    folder of the scans, OBJECT/textured.obj."""
    recipe: Literal["paper", "short", "refine"] = "paper"
    """Optimiser and schedule; `short` is for a CPU, `refine` goes on from --init."""
    steps: int | None = None
    """Steps of the optimiser, instead of the recipe's."""
    batch: int | None = None
    """Pairs in each step, instead of the recipe's."""
    precision: Literal["auto", "bf16", "fp32"] = "auto"
    """Of the network's arithmetic; auto is bf16, mixed with 32 bits, on CUDA."""
    init: Path | None = None
    """Weights to start from (.safetensors)."""
    workers: int = 1
    """Processes that make the pairs."""
    threads: int | None = None
    """Threads of the network's own arithmetic; all cores by default."""
    minutes: float | None = None
    """Stop after this time; run again to go on."""
    epoch: int = 8000
    """Distinct pairs; seen again with other points after that."""
    points: int | None = None
    """Observed and prior points while training, instead of the preset's; fewer train faster."""
    keypoints: int | None = None
    """Keypoints while training, instead of the preset's."""
    held_out: int = 192
    """Pairs for validation, of other shapes (with --meshes the same shapes, other views) or of
    recordings that are held out; 0 validates nothing."""
    out: Annotated[Path, tyro.conf.arg(metavar="DIR")]
    """Folder of checkpoints, log and network."""


def run(options: Options) -> None:
    """Train."""
    import time
    from dataclasses import replace

    import torch

    from robust6dof.network.checkpoint import load_network
    from robust6dof.network.config import preset
    from robust6dof.network.device import resolve_device
    from robust6dof.training.loop import TrainConfig, train
    from robust6dof.training.recipe import recipe_named

    if options.threads:
        torch.set_num_threads(options.threads)
    init = load_network(options.init) if options.init else None
    network = preset(options.preset)
    given = {"steps": options.steps, "batch": options.batch}
    recipe = replace(
        recipe_named(options.recipe), **{k: v for k, v in given.items() if v is not None}
    )
    trained = replace(
        network,
        points=options.points or network.points,
        prior_points=options.points or network.prior_points,
        keypoints=options.keypoints or network.keypoints,
    )
    pairs, held_out = _pair_sets(options, trained, recipe.steps * recipe.batch)
    end = time.monotonic() + 60 * options.minutes if options.minutes else float("inf")
    train(
        TrainConfig(
            trained,
            recipe,
            seed=options.seed,
            data=_description(options),
            precision=options.precision,
            workers=options.workers,
        ),
        pairs,
        held_out,
        options.out,
        init=init,
        device=resolve_device(options.device),
        stop=lambda: time.monotonic() > end,
    )
    print(f"weights: {options.out / 'network.safetensors'}")


def _description(options: Options) -> dict[str, Any]:
    """What decides the pairs, for a run to be known again by."""
    names = ("data", "gap", "categories", "epoch", "held_out")
    paths = {"from": options.source, "models": options.models, "meshes": options.meshes}
    return (
        {name: getattr(options, name) for name in names}
        | {name: str(path.resolve()) for name, path in paths.items() if path}
        | {"replay": [str(run.resolve()) for run in options.replay]}
    )


def _pair_sets(options: Options, network: NetworkConfig, count: int) -> PairSets:
    """Pairs to learn from and pairs to validate on, from recordings or rendered."""
    from robust6dof.errors import InputError
    from robust6dof.training.pair_sets import make_pair_sets

    replayed = _replayed(options)
    if options.source is not None:
        return _recorded_sets(options, options.source, network, count, replayed)
    if options.data in ("nocs", "recordings"):
        raise InputError(f"--data {options.data} needs its folder as --from")
    names, objects, varied = _world(options)
    sizes = (options.seed, options.epoch, count, options.held_out)
    pairs, held_out = make_pair_sets(network, *sizes, names, objects, varied, replayed)
    return pairs, held_out if options.held_out else None


def _recorded_sets(
    options: Options, source: Path, network: NetworkConfig, count: int, replayed: Replayed
) -> PairSets:
    from robust6dof.data.recognition import recognise
    from robust6dof.errors import DataError, InputError
    from robust6dof.training.pair_sets import make_recorded_sets
    from robust6dof.training.recorded_clips import open_clips

    if options.data == "aerial" or options.meshes is not None:
        raise InputError("--from goes with --data recordings, nocs or ycb-video, without --meshes")
    kind = recognise(source)
    if options.data not in ("recordings", kind):
        raise DataError(source, f"this is {kind}, not {options.data}", "Say --data recordings")
    clips = open_clips(source, options.categories, options.models)
    names = sorted({clip.category for clip in clips})
    recordings = len({clip.sequence.name for clip in clips})
    print(f"{source}: {recordings} recordings of {', '.join(names)}", flush=True)
    sizes = (options.seed, options.epoch, count, options.held_out)
    return make_recorded_sets(network, *sizes, clips, options.gap, replayed)


def _replayed(options: Options) -> Replayed:
    if not options.replay:
        return {}
    from robust6dof.training.replayed_errors import read_errors

    replayed = read_errors(options.replay)
    counts = ", ".join(f"{len(pairs)} of {name}" for name, pairs in sorted(replayed.items()))
    print(f"errors to replay: {counts}", flush=True)
    return replayed


def _world(options: Options) -> tuple[tuple[str, ...], dict[str, list[ObjectModel]], PairConfig]:
    """Names, the objects that are not procedural, and what pairs of them vary."""
    from robust6dof.errors import InputError
    from robust6dof.frames import CATEGORIES, YCB_OBJECTS
    from robust6dof.shapes.loading import load_category
    from robust6dof.shapes.ycb_objects import load_ycb_scan
    from robust6dof.training.pairs import PairConfig

    names, folder = options.categories, options.meshes
    if options.data == "aerial":
        names = names or CATEGORIES
        objects = {name: load_category(folder, name) for name in names} if folder else {}
        return names, objects, PairConfig()
    names = names or YCB_OBJECTS
    if unknown := [name for name in names if name not in YCB_OBJECTS]:
        raise InputError(f"not of YCB-Video: {', '.join(unknown)}; it has {', '.join(YCB_OBJECTS)}")
    if folder is None:
        raise InputError(
            "--data ycb-video needs the folder of YCB's google_16k scans as --meshes, or its own "
            "videos as --from"
        )
    return names, {name: [load_ycb_scan(folder, name)] for name in names}, PairConfig.lying()
