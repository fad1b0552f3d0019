"""Build a category's shape prior (2,048 points) from procedural objects or your own meshes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from robust6dof.cli.options import CommonOptions


@dataclass(frozen=True, kw_only=True)
class Options(CommonOptions):
    category: str
    """One of the six built in, a YCB object (006_mustard_bottle), or the name of a folder in
    --meshes."""
    out: Path
    """Where the points go (.npy, 2048 × 3, canonical axes, box centred at 0, diagonal 1)."""
    meshes: Path | None = None
    """Folder with CATEGORY/*.glb, .obj or .ply; without it, procedural objects."""
    count: int = 24
    """Procedural objects to use."""
    up: Literal["y", "z"] = "y"
    """Which axis of the meshes points up."""
    unit: Literal["m", "cm", "mm"] = "m"
    """Unit of the meshes."""


def run(options: Options) -> None:
    import numpy as np

    from robust6dof.shapes.priors import build_prior

    points = build_prior(_objects(options), options.seed, progress=print)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    with options.out.open("wb") as file:
        np.save(file, points)
    print(f"{options.out}: {len(points)} points, extents {np.ptp(points, axis=0).round(3)}")


def _objects(options: Options) -> list:
    from robust6dof.shapes.loading import load_category
    from robust6dof.shapes.procedural import PRIOR_SEEDS, make_object
    from robust6dof.shapes.ycb_objects import YCB_SIDES_M, make_ycb_stand_in

    if options.meshes is not None:
        return load_category(options.meshes, options.category, up=options.up, unit=options.unit)
    if options.category in YCB_SIDES_M:
        return [make_ycb_stand_in(options.category)]
    first = PRIOR_SEEDS + 10_000 * options.seed
    return [make_object(options.category, first + i) for i in range(options.count)]
