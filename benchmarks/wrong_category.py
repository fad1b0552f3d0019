"""What the tracker claims of an object that it was told the wrong category of.

    python benchmarks/wrong_category.py SET [SET …] [--frames 6] [--out FILE]

Every recording's object is started on its first frame from its mask, and again from its disturbed
pose and size, as each of the six categories, and followed for some frames. A pose is right within
10° and 5 cm; turns about y do not count where the object or the category that was told has none.
`sure` is a confidence of at least one half.
"""

from __future__ import annotations

import argparse
import json
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from robust6dof.data import read_video
from robust6dof.data.truth_file import FILE_NAME, read_truth_file
from robust6dof.errors import InputError
from robust6dof.evaluation.start_noise import perturb
from robust6dof.frames import CATEGORIES, SYMMETRIC_CATEGORIES, RgbdFrame, Track
from robust6dof.shapes.priors import load_prior
from robust6dof.tracking.disagreement import Disagreement
from robust6dof.tracking.likeness import CategoryShape
from robust6dof.tracking.tracker import Tracker

HINTS = ("mask", "pose")
OUTCOMES = ("right, sure", "right, unsure", "wrong, sure", "wrong, unsure", "refused")


@dataclass(frozen=True)
class Trial:
    """One object as one category."""

    recording: str
    hint: str
    true: str
    told: str
    rotation_deg: float
    translation_cm: float
    confidence: float
    state: str
    strangeness: float
    """Of the last frame: see `robust6dof.tracking.likeness`."""

    @property
    def outcome(self) -> str:
        if not np.isfinite(self.rotation_deg):
            return "refused"
        right = self.rotation_deg < 10.0 and self.translation_cm < 5.0
        sure = self.confidence >= 0.5
        return f"{'right' if right else 'wrong'}, {'sure' if sure else 'unsure'}"


def trials(folder: Path, trackers: dict[str, Tracker], frames: int) -> Iterator[Trial]:
    """Of one recording."""
    truths, video = read_truth_file(folder / FILE_NAME), read_video(folder)
    last = min(frames, len(video) - 1)
    true, seed = truths[0].category, sum(map(ord, folder.name))
    for hint in HINTS:
        for told, tracker in trackers.items():
            try:
                track = tracker.start(video[0], **start_from(hint, video, truths[0], seed))
            except InputError:
                yield Trial(folder.name, hint, true, told, np.inf, np.inf, 0.0, "", np.nan)
                continue
            for index in range(1, last + 1):
                track = tracker.step(track, video[index])
            truth = truths[last]
            symmetric = truth.symmetric or told in SYMMETRIC_CATEGORIES
            T_cam_obj = truth.T_cam_obj
            apart = Disagreement.between(track.T_cam_obj, 1.0, T_cam_obj, 1.0, symmetric)
            errors = float(np.rad2deg(apart.rotation)), 100.0 * apart.translation
            strange = strangeness(video[last], track)
            state = track.state.value
            yield Trial(folder.name, hint, true, told, *errors, track.confidence, state, strange)


def strangeness(frame: RgbdFrame, track: Track) -> float:
    """Of what was seen, were it of the category that was told."""
    shape = CategoryShape(load_prior(track.category), track.category)
    points = track.memory.seen_points
    return shape.strangeness(frame, track.T_cam_obj, track.extents, points)


def start_from(hint: str, video: Any, truth: Any, seed: int) -> dict[str, Any]:
    """Arguments of `start`."""
    if hint == "mask":
        return {"mask": video.mask(0)}
    T_cam_obj, extents = perturb(truth.T_cam_obj, truth.extents, np.random.default_rng(seed))
    return {"T_cam_obj": T_cam_obj, "extents": extents}


def table(done: Sequence[Trial]) -> str:
    """Outcomes for each hint, told rightly and wrongly, and for each category told wrongly."""
    lines = ["| told | " + " | ".join(OUTCOMES) + " |", "|---" * (len(OUTCOMES) + 1) + "|"]
    for hint in HINTS:
        part = [trial for trial in done if trial.hint == hint]
        rows = {f"{hint}, the right category": [t for t in part if t.told == t.true]}
        wrong = [trial for trial in part if trial.told != trial.true]
        rows[f"{hint}, a wrong category"] = wrong
        for told in CATEGORIES:
            rows[f"{hint}, wrongly {told}"] = [trial for trial in wrong if trial.told == told]
        for name, some in rows.items():
            counts = Counter(trial.outcome for trial in some)
            lines.append(f"| {name} | " + " | ".join(str(counts[o]) for o in OUTCOMES) + " |")
    return "\n".join(lines)


def strangeness_table(done: Sequence[Trial]) -> str:
    """Of the right category placed rightly, and of whatever was placed wrongly."""
    lines = ["| told | right: median | 95 % | highest | wrong: lowest | 5 % | median |"]
    lines.append("|---" * 7 + "|")
    for told in CATEGORIES:
        some = [t for t in done if t.told == told and t.outcome != "refused"]
        right = [t.strangeness for t in some if t.true == told and t.outcome.startswith("right")]
        wrong = [t.strangeness for t in some if t.outcome.startswith("wrong")]
        cells = [*quantiles(right, [50, 95, 100]), *quantiles(wrong, [0, 5, 50])]
        lines.append(f"| {told} | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def quantiles(values: list[float], percents: list[float]) -> list[str]:
    """Two digits each; dashes where there is none."""
    if not values:
        return ["–"] * len(percents)
    return [f"{value:.2f}" for value in np.percentile(values, percents)]


def main() -> None:
    parser = argparse.ArgumentParser(description="Tell the tracker wrong categories")
    parser.add_argument("sets", type=Path, nargs="+")
    parser.add_argument("--frames", type=int, default=6)
    parser.add_argument("--out", type=Path, help="all trials, as JSON")
    options = parser.parse_args()
    trackers = {name: Tracker.from_pretrained(category=name) for name in CATEGORIES}
    folders = sorted(file.parent for part in options.sets for file in part.glob(f"*/{FILE_NAME}"))
    done: list[Trial] = []
    for folder in folders:
        done += trials(folder, trackers, options.frames)
        print(f"{folder.name}: {len(done)} trials", flush=True)
        if options.out:
            options.out.write_text(json.dumps([asdict(trial) for trial in done], indent=1))
    print(table(done))
    print()
    print(strangeness_table(done))


if __name__ == "__main__":
    main()
