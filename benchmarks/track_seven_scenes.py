"""Errors on the two mugs of a real hand-held recording (7-Scenes RedKitchen, depth alone).

    python benchmarks/track_seven_scenes.py DATA/seven_scenes_mugs [--tracker icp] [--out DIR]

The reference poses are derived from the depth maps and the recorded camera poses; they are
uncertain by 1 to 3 cm themselves. The reference's frame has its origin on the cup's axis; the
tracker's is the centre of the box with the handle, so references are moved there first.
"""

from __future__ import annotations

import argparse
import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from robust6dof.baselines.registry import make_tracker
from robust6dof.data import read_video
from robust6dof.frames import Box, Track
from robust6dof.geometry.boxes import box_corners
from robust6dof.geometry.camera import project
from robust6dof.geometry.transforms import axis_error, make_transform, rotation_error

MUGS = {"A": (281, 407), "B": (196, 307)}
"""Frame numbers in which each mug is in view."""
STARTS = ("pose", "box")


@dataclass(frozen=True, eq=False)
class Reference:
    """One mug's poses, about the centre of its box."""

    frames: dict[str, np.ndarray]
    extents: np.ndarray


@dataclass(frozen=True, eq=False)
class Run:
    """A tracked mug beside its reference."""

    names: list[str]
    tracks: list[Track]
    rotation_deg: np.ndarray
    axis_deg: np.ndarray
    """Between the up axes: all that counts while the handle is hidden."""
    translation_cm: np.ndarray


def read_reference(folder: Path, mug: str) -> Reference:
    """The derived poses of one mug and its size [m]."""
    content = json.loads((folder / "derived_mug_reference.json").read_text())
    size = content["mugs"][mug]
    reach, radius = size["handle_reach_from_axis_m"], size["radius_m"]
    T_axis_box = make_transform(np.eye(3), np.array([(reach - radius) / 2, 0.0, 0.0]))
    frames = {
        f"frame-{number}": np.array(poses[mug]) @ T_axis_box
        for number, poses in content["frames_object_to_camera"].items()
        if mug in poses
    }
    return Reference(frames, np.array([reach + radius, size["height_m"], 2 * radius]))


def track_mug(folder: Path, mug: str, tracker_name: str, start: str) -> Run:
    """Track one mug from its first frame, started with the reference pose or its image box."""
    reference = read_reference(folder, mug)
    video = read_video(folder, fps=30.0, depth_only=True)
    first, last = (video.names.index(f"frame-{number:06d}") for number in MUGS[mug])
    tracker = make_tracker(tracker_name, "mug")
    tracks: list[Track] = []
    for frame in video[first : last + 1]:
        if tracks:
            tracks.append(tracker.step(tracks[-1], frame))
            continue
        T_cam_obj = reference.frames[frame.name]
        if start == "pose":
            hint = {"T_cam_obj": T_cam_obj, "extents": reference.extents}
        else:
            hint = {"box": _image_box(T_cam_obj, reference.extents, frame.K)}
        tracks.append(tracker.start(frame, **hint))
    return _compare(list(video.names[first : last + 1]), tracks, reference)


def _compare(names: list[str], tracks: list[Track], reference: Reference) -> Run:
    known = [name in reference.frames for name in names]
    pairs = [
        (track.T_cam_obj, reference.frames[name])
        for name, track, there in zip(names, tracks, known, strict=True)
        if there
    ]
    ours, theirs = (np.stack(side) for side in zip(*pairs, strict=True))
    return Run(
        names,
        tracks,
        np.degrees(rotation_error(ours[:, :3, :3], theirs[:, :3, :3])),
        np.degrees(axis_error(ours[:, :3, :3], theirs[:, :3, :3])),
        100.0 * np.linalg.norm(ours[:, :3, 3] - theirs[:, :3, 3], axis=-1),
    )


def _image_box(T_cam_obj: np.ndarray, extents: np.ndarray, K: np.ndarray) -> Box:
    pixels = project(box_corners(T_cam_obj, extents), K)
    low, high = pixels.min(axis=0), pixels.max(axis=0)
    return Box(float(low[0]), float(low[1]), *(float(side) for side in high - low))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--tracker", default="icp")
    options = parser.parse_args()
    print("mug  start  frames  tracking   rotation deg    axis deg        translation cm")
    print("                               median   max    median   max    median   max")
    for mug in MUGS:
        for start in STARTS:
            run = track_mug(options.folder, mug, options.tracker, start)
            held = np.mean([track.state == "tracking" for track in run.tracks])
            numbers = "  ".join(
                f"{np.median(errors):6.1f} {np.max(errors):6.1f} "
                for errors in (run.rotation_deg, run.axis_deg, run.translation_cm)
            )
            print(f"{mug:3}  {start:5}  {len(run.tracks):6d}  {held:7.0%}  {numbers}", flush=True)


if __name__ == "__main__":
    main()
