"""What recordings there are to be: any number from a seed, or the splits of AerialPose-Sim."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from robust6dof.errors import InputError
from robust6dof.frames import CATEGORIES
from robust6dof.shapes.loading import category_files
from robust6dof.synthetic.difficulty import BENCHMARK_DIFFICULTIES, DIFFICULTIES

VERSION = "1.0"
"""Of AerialPose-Sim; written into every recording's plan. It changes when the recordings do."""
FIRST_TEST_SHAPE = 2_000_000
"""Procedural shapes from this seed on are for benchmarks; training never draws them."""


@dataclass(frozen=True)
class Split:
    """A part of AerialPose-Sim: for each seed, every category at every difficulty."""

    seeds: tuple[int, ...]
    frames: int
    """In each recording, at 30 Hz; some never arrive."""


SPLITS: dict[str, Split] = {
    "mini": Split(seeds=(0,), frames=60),
    "full": Split(seeds=(1, 2, 3), frames=120),
}
"""To develop on, and to report on."""


@dataclass(frozen=True)
class SequencePlan:
    """All that determines one recording."""

    name: str
    category: str
    difficulty: str
    seed: int
    frames: int
    shape_seed: int
    mesh: Path | None = None
    """A user's mesh instead of the procedural shape."""
    alike: tuple[Path, ...] = ()
    """The user's meshes of that category: distractors come from there too."""


def plan_split(name: str, meshes: Path | None = None) -> list[SequencePlan]:
    """The recordings of a split of AerialPose-Sim; with `meshes` those of its mesh variant.

    Raises:
        InputError: no such split.
        DataError: no meshes of a category.
    """
    if name not in SPLITS:
        raise InputError(f"no split '{name}'; there is: {', '.join(SPLITS)}")
    split = SPLITS[name]
    count = len(CATEGORIES) * len(BENCHMARK_DIFFICULTIES)
    plans = [plan_aerial(seed, count, split.frames, meshes=meshes) for seed in split.seeds]
    return [plan for of_seed in plans for plan in of_seed]


def plan_aerial(
    seed: int,
    sequences: int,
    frames: int = 120,
    difficulties: Sequence[str] = BENCHMARK_DIFFICULTIES,
    categories: Sequence[str] = CATEGORIES,
    meshes: Path | None = None,
) -> list[SequencePlan]:
    """`sequences` recordings that go through categories and difficulties in turn.

    Args:
        seed: recording i has its own stream (seed, i), whatever the others are.
        sequences: how many.
        frames: in each.
        difficulties: calm, agile, harsh, leaving.
        categories: of the targets.
        meshes: folder CATEGORY/MESH to take targets from.

    Raises:
        InputError: an unknown difficulty, a category without shapes, or no sequence.
        DataError: no meshes of a category.
    """
    _check(sequences, difficulties, categories, meshes)
    files = {name: tuple(category_files(meshes, name)) if meshes else () for name in categories}
    plans = []
    for index in range(sequences):
        category = categories[index % len(categories)]
        turn = index // len(categories)
        difficulty = difficulties[turn % len(difficulties)]
        alike = files[category]
        mesh = alike[(seed * len(difficulties) + turn) % len(alike)] if alike else None
        plans.append(
            SequencePlan(
                name=f"s{seed}_{index:04d}_{category}_{difficulty}",
                category=category,
                difficulty=difficulty,
                seed=1_000_000 * seed + index,
                frames=frames,
                shape_seed=FIRST_TEST_SHAPE + 1000 * seed + index,
                mesh=mesh,
                alike=_distractors(alike, mesh) if difficulty == "leaving" else alike,
            )
        )
    return plans


def _distractors(alike: tuple[Path, ...], mesh: Path | None) -> tuple[Path, ...]:
    """Without the target's own mesh: nothing could tell which of two such objects had been lost."""
    return tuple(path for path in alike if path != mesh) or alike


def _check(
    sequences: int, difficulties: Sequence[str], categories: Sequence[str], meshes: Path | None
) -> None:
    if set(difficulties) - set(DIFFICULTIES) or sequences < 1:
        raise InputError(
            f"--difficulty takes {', '.join(DIFFICULTIES)}, --sequences a number from 1 on"
        )
    unknown = sorted(set(categories) - set(CATEGORIES))
    if unknown and meshes is None:
        raise InputError(
            f"there are no procedural shapes of {', '.join(unknown)}: "
            "give a folder with CATEGORY/MESH files by --meshes"
        )
