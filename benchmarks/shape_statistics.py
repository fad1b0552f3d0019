"""Print sizes and proportions of procedural objects beside those of real ones, as Markdown.

python benchmarks/shape_statistics.py --meshes DIR --real275 real275_train_index.json
python benchmarks/shape_statistics.py --parameters      # ranges that parameters are drawn from
python benchmarks/shape_statistics.py --priors mean_points_emb.npy --meshes DIR
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import tyro

from robust6dof.frames import CATEGORIES
from robust6dof.shapes.draw import Draw
from robust6dof.shapes.loading import load_objects
from robust6dof.shapes.mesh import ObjectModel
from robust6dof.shapes.priors import chamfer, load_prior
from robust6dof.shapes.procedural import MAKERS, make_object
from robust6dof.shapes.sampling import sample_surface


@dataclass(frozen=True)
class Options:
    count: int = 200
    """Procedural objects of each category."""
    meshes: Path | None = None
    """Folder of scanned meshes, DIR/category/file."""
    real275: Path | None = None
    """Index of the REAL275 train objects (category, size_m)."""
    parameters: bool = False
    """Print the parameters' ranges instead."""
    priors: Path | None = None
    """Published mean points (6, N, 3), order bottle … mug: compare the shipped priors with them."""


def size_row(name: str, extents: np.ndarray) -> str:
    """Lowest to highest of size and proportions."""
    diagonal = np.linalg.norm(extents, axis=1)
    share = extents / diagonal[:, None]
    cells = [f"{1000 * diagonal.min():.0f} to {1000 * diagonal.max():.0f}"]
    cells += [f"{share[:, i].min():.2f} to {share[:, i].max():.2f}" for i in range(3)]
    return f"| {name} | {len(extents)} | " + " | ".join(cells) + " |"


def print_sizes(options: Options) -> None:
    scanned = {} if options.meshes is None else load_objects(options.meshes)
    real = [] if options.real275 is None else json.loads(options.real275.read_text())
    print("| objects | number | diagonal [mm] | x / diagonal | y / diagonal | z / diagonal |")
    print("|---|---|---|---|---|---|")
    for category in CATEGORIES:
        made = [make_object(category, seed).extents for seed in range(options.count)]
        print(size_row(f"{category}, procedural", np.array(made)))
        if category in scanned:
            extents = np.array([one.extents for one in scanned[category]])
            print(size_row(f"{category}, scanned", extents))
        sizes = [one["size_m"] for one in real if one["category"] == category]
        if sizes:
            print(size_row(f"{category}, REAL275 train", np.array(sizes)))


def print_parameters(options: Options) -> None:
    print("| category | parameter | drawn from |")
    print("|---|---|---|")
    for category, maker in MAKERS.items():
        ranges: dict[str, tuple] = {}
        for seed in range(options.count):
            draw = Draw(np.random.default_rng(seed))
            maker(draw)
            for name, drawn_from in draw.ranges.items():
                ranges[name] = _widened(ranges.get(name), drawn_from)
        for name, drawn_from in ranges.items():
            words = ", ".join(map(str, drawn_from))
            if not isinstance(drawn_from[0], str):
                words = f"{drawn_from[0]:g} to {drawn_from[1]:g}"
            print(f"| {category} | {name} | {words} |")


def _widened(old: tuple | None, new: tuple) -> tuple:
    if old is None or isinstance(new[0], str):
        return new
    return min(old[0], new[0]), max(old[1], new[1])


def print_priors(options: Options, means: Path) -> None:
    """Chamfer distances in units of the diagonal."""
    published = np.load(means)
    scanned = {} if options.meshes is None else load_objects(options.meshes)
    print("| category | to the published mean | to scans | published to scans | random to scans |")
    print("|---|---|---|---|---|")
    for category, mean in zip(CATEGORIES, published, strict=True):
        scaled = mean / np.linalg.norm(np.ptp(mean, axis=0))
        prior = load_prior(category)
        targets = [_cloud(scan) for scan in scanned.get(category, [])]
        random = [_cloud(make_object(category, seed)) for seed in range(20)]
        values = [
            chamfer(prior, scaled),
            _mean_distance([prior], targets),
            _mean_distance([scaled], targets),
            _mean_distance(random, targets),
        ]
        print(f"| {category} | " + " | ".join(f"{value:.4f}" for value in values) + " |")


def _cloud(made: ObjectModel) -> np.ndarray:
    return sample_surface(made.mesh, 2048, np.random.default_rng(0))[0] / made.scale


def _mean_distance(shapes: list, targets: list) -> float:
    return float(np.mean([chamfer(shape, target) for shape in shapes for target in targets]))


def main(options: Options) -> None:
    if options.parameters:
        print_parameters(options)
    elif options.priors is not None:
        print_priors(options, options.priors)
    else:
        print_sizes(options)


if __name__ == "__main__":
    main(tyro.cli(Options, description=__doc__))
