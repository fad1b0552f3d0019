"""Sets of synthetic recordings on disk, AerialPose-Sim among them: the same from the same seed."""

from __future__ import annotations

import json
import os
import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from robust6dof.data.sequence_writer import SequenceWriter
from robust6dof.data.truth_file import FILE_NAME, AnnotatedTruth, write_truth_file
from robust6dof.errors import DataError, InputError
from robust6dof.frames import CATEGORIES, RgbdFrame
from robust6dof.shapes.loading import load_object
from robust6dof.shapes.mesh import ObjectModel
from robust6dof.shapes.procedural import make_object
from robust6dof.synthetic.difficulty import DIFFICULTIES
from robust6dof.synthetic.sequence import FrameTruth, SyntheticSequence

VERSION = "0.1"
"""Of AerialPose-Sim; its sequences may change with it, and scores name it."""
FIRST_TEST_SHAPE = 2_000_000
"""Procedural shapes from this seed on are for benchmarks; training never draws them."""
MESH_SUFFIXES = (".glb", ".obj", ".ply")


@dataclass(frozen=True)
class SequencePlan:
    """All that determines one recording."""

    name: str
    category: str
    difficulty: str
    seed: int
    frames: int
    shape_seed: int
    mesh: str | None = None
    """A user's mesh instead of the procedural shape."""


def plan_aerial(
    seed: int,
    sequences: int,
    frames: int = 120,
    difficulties: Sequence[str] = tuple(DIFFICULTIES),
    categories: Sequence[str] = CATEGORIES,
    meshes: Path | None = None,
) -> list[SequencePlan]:
    """`sequences` recordings that go through categories and difficulties in turn.

    Args:
        seed: benchmark seed; recording i has its own stream (seed, i), whatever the others are.
        sequences: how many.
        frames: in each.
        difficulties: calm, agile, harsh.
        categories: of the targets.
        meshes: folder with `<category>/*.glb|obj|ply` to take targets from.

    Raises:
        InputError: an unknown difficulty, or no sequence.
        DataError: no meshes of a category.
    """
    unknown = set(difficulties) - set(DIFFICULTIES)
    if unknown or sequences < 1:
        raise InputError(
            f"--difficulty takes {', '.join(DIFFICULTIES)}, --sequences a number from 1 on"
        )
    files = {name: _mesh_files(meshes, name) for name in categories} if meshes else {}
    plans = []
    for index in range(sequences):
        category = categories[index % len(categories)]
        turn = index // len(categories)
        difficulty = difficulties[turn % len(difficulties)]
        shape = FIRST_TEST_SHAPE + 1000 * seed + index
        mesh = (
            files[category][(turn // len(difficulties)) % len(files[category])] if files else None
        )
        plans.append(
            SequencePlan(
                name=f"{index:04d}_{category}_{difficulty}",
                category=category,
                difficulty=difficulty,
                seed=1_000_000 * seed + index,
                frames=frames,
                shape_seed=shape,
                mesh=str(mesh) if mesh else None,
            )
        )
    return plans


def synthesize(plan: SequencePlan, out: Path) -> Path:
    """Write one recording in the layout of `read_video`, with `ground_truth.jsonl`.

    A whole one of the same plan that is there already is kept; a torn one is made again.
    """
    folder = out / plan.name
    if is_done(plan, folder):
        return folder
    making = out / f".{plan.name}.making"
    shutil.rmtree(making, ignore_errors=True)
    sequence = SyntheticSequence.draw(_target(plan), plan.difficulty, plan.seed, plan.frames)
    writer = SequenceWriter(making)
    truths, twists = [], []
    for index in range(len(sequence)):
        frame, truth = sequence.frame(index)
        writer.add(frame, mask=truth.mask, T_cam_obj=truth.T_cam_obj)
        truths.append(_line(plan, frame, truth))
        twists.append({"frame": frame.name, "camera_twist": truth.camera_twist.tolist()})
    write_truth_file(making / FILE_NAME, truths)
    (making / "camera_twist.jsonl").write_text("".join(json.dumps(t) + "\n" for t in twists))
    (making / "plan.json").write_text(_plan_text(plan))
    shutil.rmtree(folder, ignore_errors=True)
    os.replace(making, folder)
    return folder


def is_done(plan: SequencePlan, folder: Path) -> bool:
    """Whether the folder holds this plan's whole recording."""
    path = folder / "plan.json"
    return path.is_file() and path.read_text() == _plan_text(plan)


def _plan_text(plan: SequencePlan) -> str:
    values = vars(plan) | {"version": VERSION}
    values["mesh"] = Path(plan.mesh).name if plan.mesh else None
    return json.dumps(values, indent=1) + "\n"


def _target(plan: SequencePlan) -> ObjectModel:
    if plan.mesh is None:
        return make_object(plan.category, plan.shape_seed)
    return load_object(Path(plan.mesh), plan.category)


def _mesh_files(meshes: Path, category: str) -> list[Path]:
    folder = meshes / category
    found = sorted(f for f in folder.glob("*") if f.suffix.lower() in MESH_SUFFIXES)
    if not found:
        raise DataError(
            folder,
            "there are no meshes",
            f"Put {', '.join(MESH_SUFFIXES)} files of a {category} there",
        )
    return found


def _line(plan: SequencePlan, frame: RgbdFrame, truth: FrameTruth) -> AnnotatedTruth:
    return AnnotatedTruth(
        name=plan.category,
        category=plan.category,
        T_cam_obj=truth.T_cam_obj,
        extents=truth.extents,
        visible_fraction=min(truth.visibility, 1.0),
        handle_visible=truth.handle_visible,
        frame=frame.name,
        stamp=frame.stamp,
        symmetric=truth.symmetric,
        difficulty=plan.difficulty,
    )
