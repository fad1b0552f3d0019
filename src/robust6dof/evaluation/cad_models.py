"""The mesh of an object of a data set: for the trackers that are given one, and say so."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

from robust6dof.data.dataset import DatasetSequence, ObjectTruth
from robust6dof.data.recordings import RecordingSequence
from robust6dof.data.truth_file import TruthFileSequence
from robust6dof.errors import InputError
from robust6dof.evaluation.frame_choice import ChosenFrames
from robust6dof.shapes.loading import MESH_SUFFIXES, load_mesh, load_object
from robust6dof.shapes.mesh import TexturedMesh
from robust6dof.shapes.procedural import make_object


def find_cad_mesh(
    sequence: DatasetSequence, truth: ObjectTruth, folders: tuple[Path, ...]
) -> TexturedMesh:
    """The object's mesh, centred on its box.

    Looked for as `<object>.<suffix>` or `<object>/textured.obj` in the folders, in the object
    frame of the data set. A synthetic recording names its own: a procedural shape is drawn again, a
    mesh looked for in the folders as `<category>/<file>`, as `robust6dof synthesize` took it.

    Raises:
        InputError: there is none.
        DataError: it cannot be read.
    """
    for folder in folders:
        for name in (truth.name, truth.category):
            files = [folder / f"{name}{suffix}" for suffix in MESH_SUFFIXES]
            for path in (*files, folder / name / "textured.obj"):
                if path.is_file():
                    mesh = load_mesh(path)
                    return replace(mesh, vertices=mesh.vertices - truth.box_center)
    planned = _planned_shape(sequence, folders)
    if planned is None:
        raise InputError(
            f"there is no mesh of {truth.name} in {sequence.name}: name a folder with "
            f"{truth.category}.ply or {truth.category}/textured.obj by --meshes, or the one that "
            "its recording was made with"
        )
    return planned


def _planned_shape(sequence: DatasetSequence, folders: tuple[Path, ...]) -> TexturedMesh | None:
    """Of the recordings that `robust6dof synthesize aerial` makes."""
    if isinstance(sequence, ChosenFrames):
        return _planned_shape(sequence.whole, folders)
    recording = sequence.recording if isinstance(sequence, TruthFileSequence) else sequence
    if not isinstance(recording, RecordingSequence):
        return None
    path = recording.video.path / "plan.json"
    plan = json.loads(path.read_text()) if path.is_file() else {}
    if plan.get("mesh"):
        places = (folder.glob(f"{plan['category']}/**/{plan['mesh']}") for folder in folders)
        files = [file for found in places for file in sorted(found)]
        return load_object(files[0], plan["category"]).mesh if files else None
    if "shape_seed" not in plan:
        return None
    return make_object(plan["category"], plan["shape_seed"]).mesh
