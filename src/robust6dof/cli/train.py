"""Train the tracker's network on the synthetic world; run again to go on where it stopped."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from robust6dof.cli.options import CommonOptions

if TYPE_CHECKING:
    from robust6dof.shapes.mesh import ObjectModel
    from robust6dof.training.pairs import PairConfig


@dataclass(frozen=True, kw_only=True)
class Options(CommonOptions):
    preset: Literal["paper", "small", "tiny"] = "small"
    """Size of the network."""
    data: Literal["aerial", "ycb-video"] = "aerial"
    """What is rendered: objects of categories, standing; or the 21 scans of YCB-Video, standing
    and lying."""
    categories: tuple[str, ...] = ()
    """Of the objects (default: the six, or all 21); with --meshes any name of a folder there that
    has a prior."""
    meshes: Path | None = None
    """Folder with CATEGORY/MESH files: objects from there, not procedural shapes. For ycb-video the
    folder of the scans, OBJECT/textured.obj."""
    recipe: Literal["paper", "short", "refine"] = "paper"
    """Optimiser and schedule; `short` is for a CPU, `refine` goes on from --init."""
    steps: int | None = None
    """Steps of the optimiser, instead of the recipe's."""
    batch: int | None = None
    """Pairs in each step, instead of the recipe's."""
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
    """Pairs of other shapes (with --meshes the same shapes, other views), for validation."""
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
    from robust6dof.training.pair_sets import make_pair_sets
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
    names, objects, varied = _world(options)
    count = recipe.steps * recipe.batch
    pairs, held_out = make_pair_sets(
        trained, options.seed, options.epoch, count, options.held_out, names, objects, varied
    )
    end = time.monotonic() + 60 * options.minutes if options.minutes else float("inf")
    train(
        TrainConfig(trained, recipe, seed=options.seed, workers=options.workers),
        pairs,
        held_out,
        options.out,
        init=init,
        device=resolve_device(options.device),
        stop=lambda: time.monotonic() > end,
    )
    print(f"weights: {options.out / 'network.safetensors'}")


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
        raise InputError("--data ycb-video needs the folder of YCB's google_16k scans as --meshes")
    return names, {name: [load_ycb_scan(folder, name)] for name in names}, PairConfig.lying()
