"""Measure how often a tracker starts rightly: by category and by what it is told of the object.

Writes trials.jsonl (one start a line; a run that was interrupted goes on there), summary.json and,
for each miss, a picture: the truth green, the start yellow.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro.conf

from robust6dof.cli.options import CommonOptions

if TYPE_CHECKING:
    from robust6dof.evaluation.start_accuracy import StartCase, StartSummary, StartTrial
    from robust6dof.frames import PoseTracker, Track


@dataclass(frozen=True, kw_only=True)
class Options(CommonOptions):
    data: Annotated[Path, tyro.conf.Positional]
    """Data set or folder of recordings with ground truth."""
    out: Path
    """Folder for the results."""
    hints: tuple[Literal["pose", "mask", "box", "click", "category"], ...] = (
        "pose",
        "mask",
        "box",
        "click",
        "category",
    )
    """What the tracker is told: the pose with noise (5°, 3 cm, 2 cm of size), the mask, its box, a
    pixel of it, or nothing but the category."""
    tracker: str = "robust6dof"
    """Which tracker: robust6dof, keypoints, icp, features, static."""
    weights: Path | None = None
    """Weights of the network's trackers; the shipped ones if not given."""
    frames: int = 5
    """Of each object in each recording, evenly spread; each is a first frame of its own."""
    least_visible: float = 0.5
    """Share of the object that shows in these."""
    pictures: int = 40
    """Most pictures of misses (beyond 20° or 10 cm)."""


def run(options: Options) -> None:
    """Start, compare, write, print the table.

    Raises:
        DataError: unusable data.
        InputError: a hint that the data cannot give.
    """
    import json
    from dataclasses import asdict

    from robust6dof.evaluation.start_accuracy import summarize

    options.out.mkdir(parents=True, exist_ok=True)
    trials = list(_trials(options))
    rows = summarize(trials)
    (options.out / "summary.json").write_text(
        json.dumps([asdict(row) for row in rows], indent=1) + "\n"
    )
    print(table(rows), end="")


def table(rows: Sequence[StartSummary]) -> str:
    """The summary as Markdown."""
    from robust6dof.evaluation.report import markdown_table
    from robust6dof.evaluation.start_accuracy import THRESHOLDS

    within = [f"within {name} [%]" for name in THRESHOLDS]
    head = ["hint", "category", "starts", *within, "median error"]
    return markdown_table(head, [_cells(row) for row in rows])


def _cells(row: StartSummary) -> list[str]:
    shares = [_share(row, name) for name in row.share]
    error = f"{row.median['rotation_deg']:.1f}°, {row.median['translation_cm']:.1f} cm"
    return [row.hint, row.category, str(row.starts), *shares, error]


def _share(row: StartSummary, name: str) -> str:
    low, high = row.interval[name]
    return f"{row.share[name]:.0f} ({low:.0f} to {high:.0f})"


def _trials(options: Options) -> Iterator[StartTrial]:
    import json
    import zlib
    from dataclasses import asdict

    import numpy as np

    from robust6dof.evaluation.start_accuracy import StartTrial, try_start

    path = options.out / "trials.jsonl"
    lines = path.read_text().splitlines() if path.is_file() else []
    done = {_key(trial): trial for trial in (StartTrial(**json.loads(line)) for line in lines)}
    trackers: dict[str, PoseTracker] = {}
    shown = 0
    with path.open("a") as file:
        for case in _cases(options):
            for hint in options.hints:
                key = (case.sequence, case.frame.name, case.truth.name, hint)
                if key in done:
                    yield done[key]
                    continue
                rng = np.random.default_rng([options.seed, zlib.crc32("/".join(key).encode())])
                tracker = _tracker(options, case.truth.category, trackers)
                trial, track = try_start(case, hint, tracker, rng)
                file.write(json.dumps(asdict(trial)) + "\n")
                file.flush()
                if shown < options.pictures and not trial.is_within("20°10cm"):
                    _draw(options.out / "misses", case, trial, track)
                    shown += 1
                yield trial


def _key(trial: StartTrial) -> tuple[str, str, str, str]:
    return trial.sequence, trial.frame, trial.object_name, trial.hint


def _cases(options: Options) -> Iterator[StartCase]:
    from tqdm import tqdm

    from robust6dof.data.truth_file import open_with_truth
    from robust6dof.evaluation.start_accuracy import choose_cases

    for sequence in tqdm(open_with_truth(options.data).sequences, desc="recordings"):
        yield from choose_cases(sequence, options.frames, options.least_visible)


def _tracker(options: Options, category: str, made: dict[str, PoseTracker]) -> PoseTracker:
    from robust6dof.baselines.registry import make_tracker

    if category not in made:
        made[category] = make_tracker(
            options.tracker,
            category,
            seed=options.seed,
            weights=options.weights,
            device=options.device,
        )
    return made[category]


def _draw(folder: Path, case: StartCase, trial: StartTrial, track: Track | None) -> None:
    from robust6dof.data.image_files import write_image
    from robust6dof.visualization.overlay import GREEN, draw_box_and_axes, draw_label, frame_image

    frame, truth = case.frame, case.truth
    image = frame_image(frame)
    if truth.extents is not None:
        image = draw_box_and_axes(image, frame.K, truth.T_cam_box, truth.extents, GREEN)
    if track is not None:
        image = draw_box_and_axes(image, frame.K, track.T_cam_obj, track.extents)
    said = trial.problem or f"{trial.rotation_deg:.0f} deg, {trial.translation_cm:.1f} cm"
    image = draw_label(image, f"{trial.category} from {trial.hint}: {said}")
    folder.mkdir(parents=True, exist_ok=True)
    name = f"{trial.sequence}_{trial.frame}_{trial.object_name}_{trial.hint}.jpg".replace("/", "_")
    write_image(folder / name, image)
