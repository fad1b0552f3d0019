"""Synthetic recordings on disk, in the layout of `read_video`: the same from the same seed."""

from __future__ import annotations

import json
from pathlib import Path

from robust6dof.data.gyro import GYRO_FILE, write_gyro
from robust6dof.data.sequence_writer import SequenceWriter
from robust6dof.data.truth_file import FILE_NAME, AnnotatedTruth, write_truth_file
from robust6dof.frames import RgbdFrame
from robust6dof.shapes.loading import load_object
from robust6dof.shapes.mesh import ObjectModel
from robust6dof.shapes.procedural import make_object
from robust6dof.synthetic.gyro import measure_turning
from robust6dof.synthetic.plans import VERSION, SequencePlan
from robust6dof.synthetic.sequence import FrameTruth, SyntheticSequence
from robust6dof.synthetic.whole_recording import is_made, making

MOTION_FILE = "camera_motion.jsonl"
"""Of each frame: the camera's velocity, linear [m/s] then angular [rad/s], in its own frame, that
relative to the target, and the exposure [s]."""


def synthesize(plan: SequencePlan, out: Path, gyro: bool = False) -> Path:
    """Write one recording in the layout of `read_video`, with `ground_truth.jsonl`.

    A whole one of the same plan that is there already is kept; a torn one is made again.

    Args:
        plan: what to make.
        out: where its folder goes.
        gyro: add `gyro.csv`, also to a recording that is kept; nothing else changes.
    """
    folder = out / plan.name
    if not is_done(plan, folder):
        _record(_sequence(plan), plan, folder)
    if gyro and not (folder / GYRO_FILE).is_file():
        write_gyro(folder, *measure_turning(_sequence(plan)))
    return folder


def _sequence(plan: SequencePlan) -> SyntheticSequence:
    target, alike = _objects(plan)
    return SyntheticSequence.draw(target, plan.difficulty, plan.seed, plan.frames, alike=alike)


def _record(sequence: SyntheticSequence, plan: SequencePlan, folder: Path) -> None:
    with making(folder, _plan_text(plan)) as place:
        writer = SequenceWriter(place)
        truths, motions = [], []
        for index in range(len(sequence)):
            frame, truth = sequence.frame(index)
            writer.add(frame, mask=truth.mask, T_cam_obj=truth.T_cam_obj)
            truths.append(_line(plan, frame, truth))
            motions.append(_motion(frame, truth, sequence.exposure_s))
        write_truth_file(place / FILE_NAME, truths)
        (place / MOTION_FILE).write_text("".join(json.dumps(m) + "\n" for m in motions))


def is_done(plan: SequencePlan, folder: Path) -> bool:
    """Whether the folder holds this plan's whole recording."""
    return is_made(folder, _plan_text(plan))


def _plan_text(plan: SequencePlan) -> str:
    values = vars(plan) | {
        "version": VERSION,
        "mesh": plan.mesh.name if plan.mesh else None,
        "alike": [path.name for path in plan.alike],
    }
    return json.dumps(values, indent=1) + "\n"


def _objects(plan: SequencePlan) -> tuple[ObjectModel, list[ObjectModel]]:
    """The target, and the objects that distractors of its category are drawn from."""
    if plan.mesh is None:
        return make_object(plan.category, plan.shape_seed), []
    models = {path: load_object(path, plan.category) for path in {plan.mesh, *plan.alike}}
    return models[plan.mesh], [models[path] for path in plan.alike]


def _motion(frame: RgbdFrame, truth: FrameTruth, exposure_s: float) -> dict[str, object]:
    return {
        "frame": frame.name,
        "camera_twist": truth.camera_twist.tolist(),
        "target_twist": truth.target_twist.tolist(),
        "exposure_s": exposure_s,
    }


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
