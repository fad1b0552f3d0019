"""How often the tracker starts rightly on real frames, by what it is told of the object.

    python benchmarks/start_on_real_frames.py DATA [--tracker robust6dof] [--out DIR]

DATA holds seven_scenes_mugs/ (two mugs, depth alone; references uncertain by 1 to 3 cm),
nocs_real275_frame/ (six objects, one frame; references derived, not the data set's) and
tabletop_frames/ (no references: only looked at). Pictures of every start go to DIR, as do the
trials, one by one: what an interrupted run has done is kept and not done again.
"""

from __future__ import annotations

import argparse
import itertools
import json
import zlib
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path

import numpy as np
from track_seven_scenes import MUGS, read_reference

from robust6dof.baselines.registry import make_tracker
from robust6dof.cli.bench_start import table
from robust6dof.data import read_video
from robust6dof.data.dataset import ObjectTruth
from robust6dof.data.depth_unit import depth_to_metres
from robust6dof.data.image_files import read_color, read_depth, read_mask, write_image
from robust6dof.data.restricted_pickle import read_npy
from robust6dof.errors import Robust6dofError
from robust6dof.evaluation.start_accuracy import (
    HINTS,
    Hint,
    StartCase,
    StartTrial,
    summarize,
    try_start,
)
from robust6dof.frames import RgbdFrame, Track
from robust6dof.geometry.camera import project
from robust6dof.geometry.transforms import make_transform
from robust6dof.tracking.segmentation import segment_click
from robust6dof.visualization.overlay import GREEN, draw_box_and_axes, draw_label, frame_image

SARNET_K = np.array([[606.9066, 0, 319.9248], [0, 606.2557, 240.7983], [0, 0, 1]])
GRASPNET = {
    "blue_mug": "mug",
    "green_bowl": "bowl",
    "white_bowl": "bowl",
    "mustard": "bottle",
    "cylinder": "can",
}


def seven_scenes_cases(folder: Path, every: int) -> Iterator[StartCase]:
    """Each n-th frame of each mug; where both are in view, the category may mean either."""
    video = read_video(folder, fps=30.0, depth_only=True)
    references = {mug: read_reference(folder, mug) for mug in MUGS}
    for mug, (first, last) in MUGS.items():
        for number in range(first, last + 1, every):
            name = f"frame-{number:06d}"
            truths = {
                other: ObjectTruth(f"mug {other}", "mug", one.frames[name], one.extents)
                for other, one in references.items()
                if name in one.frames and MUGS[other][0] <= number <= MUGS[other][1]
            }
            if mug in truths:
                alike = tuple(truth for other, truth in truths.items() if other != mug)
                frame = video[video.names.index(name)]
                yield StartCase(f"7-Scenes mug {mug}", frame, truths[mug], alike)


def nocs_cases(folder: Path) -> Iterator[StartCase]:
    """The six objects of one frame of NOCS-REAL275."""
    content = json.loads((folder / "derived_reference_poses.json").read_text())
    depth = depth_to_metres(read_depth(folder / "0000_depth.png"), 0.001)
    frame = RgbdFrame(
        read_color(folder / "0000_color.png"), depth, np.array(content["K"]), name="0"
    )
    truths = [
        ObjectTruth(
            name.removesuffix("_norm"),
            name.split("_")[0],
            make_transform(np.array(entry["R"]), np.array(entry["t_m"])),
            np.array(entry["size_m"]),
        )
        for name, entry in content["objects"].items()
    ]
    for truth in truths:
        alike = tuple(
            other for other in truths if other is not truth and other.category == truth.category
        )
        yield StartCase("NOCS frame", frame, truth, alike)


def tabletop_starts(folder: Path, tracker_name: str) -> Iterator[tuple[str, RgbdFrame, Track]]:
    """Frames without references, started from a mask or from a click on the object."""
    mug = folder / "sarnet_d435_mug"
    depth = depth_to_metres(read_depth(mug / "0000_depth.png"), 0.001)
    frame = RgbdFrame(read_color(mug / "0000_image.png"), depth, SARNET_K, name="0000")
    mask = read_mask(mug / "0000_mask.png")
    yield "sarnet_mug", frame, make_tracker(tracker_name, "mug").start(frame, mask=mask)
    for name, category in GRASPNET.items():
        fields = read_npy(folder / "nv_6dof_graspnet" / f"{name}.npy").item()
        depth = np.nan_to_num(fields["depth"]).astype(np.float32)
        frame = RgbdFrame(fields["image"], depth, fields["intrinsics_matrix"], name=name)
        x, y = np.median(project(fields["smoothed_object_pc"], frame.K), axis=0)
        try:
            mask = segment_click(frame, float(x), float(y)).mask
            yield name, frame, make_tracker(tracker_name, category).start(frame, mask=mask)
        except Robust6dofError as error:
            print(f"{name}: {error}")


def draw(path: Path, frame: RgbdFrame, track: Track | None, truth: ObjectTruth | None) -> None:
    image = frame_image(frame)
    if truth is not None and truth.extents is not None:
        image = draw_box_and_axes(image, frame.K, truth.T_cam_obj, truth.extents, GREEN)
    if track is not None:
        image = draw_box_and_axes(image, frame.K, track.T_cam_obj, track.extents)
        image = draw_label(image, f"{track.category}  confidence {track.confidence:.2f}")
    path.parent.mkdir(parents=True, exist_ok=True)
    write_image(path, image)


def _trials(options: argparse.Namespace) -> Iterator[StartTrial]:
    """Each case from each kind of hint; done ones as they are in trials.jsonl."""
    options.out.mkdir(parents=True, exist_ok=True)
    path = options.out / "trials.jsonl"
    lines = path.read_text().splitlines() if path.is_file() else []
    done = {_key(trial): trial for trial in (StartTrial(**json.loads(line)) for line in lines)}
    hints: list[Hint] = [hint for hint in HINTS if hint != "mask"]
    cases = itertools.chain(
        seven_scenes_cases(options.data / "seven_scenes_mugs", options.every),
        nocs_cases(options.data / "nocs_real275_frame"),
    )
    with path.open("a") as file:
        for case, hint in itertools.product(cases, hints):
            key = f"{case.sequence}/{case.frame.name}/{case.truth.name}/{hint}"
            if key not in done:
                done[key] = _try(options, case, hint, key)
                file.write(json.dumps(asdict(done[key])) + "\n")
                file.flush()
            yield done[key]


def _key(trial: StartTrial) -> str:
    return f"{trial.sequence}/{trial.frame}/{trial.object_name}/{trial.hint}"


def _try(options: argparse.Namespace, case: StartCase, hint: Hint, key: str) -> StartTrial:
    rng = np.random.default_rng([0, zlib.crc32(key.encode())])
    tracker = make_tracker(options.tracker, case.truth.category)
    trial, track = try_start(case, hint, tracker, rng)
    draw(options.out / f"{key.replace('/', '_')}.jpg", case.frame, track, case.truth)
    print(f"{key}: {trial.rotation_deg:.0f}°, {trial.translation_cm:.1f} cm", flush=True)
    return trial


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("data", type=Path)
    parser.add_argument("--tracker", default="robust6dof")
    parser.add_argument("--every", type=int, default=15, help="of the mugs' frames")
    parser.add_argument("--out", type=Path, default=Path("out/real_starts"))
    options = parser.parse_args()
    trials = list(_trials(options))
    for source in ("7-Scenes", "NOCS"):
        print(f"\n{source}\n")
        print(table(summarize([trial for trial in trials if trial.sequence.startswith(source)])))
    for name, frame, track in tabletop_starts(options.data / "tabletop_frames", options.tracker):
        draw(options.out / f"tabletop_{name}.jpg", frame, track, None)


if __name__ == "__main__":
    main()
