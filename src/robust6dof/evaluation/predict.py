"""First loop: run a tracker over a data set and store its poses. Nothing is scored here.

    RUN/run.json                              what made it
    RUN/<sequence>/<object>/track.jsonl       one line a frame: pose, extents, state, ms
    RUN/<sequence>/done.json                  the sequence is finished

Truth reaches the tracker on its first frame only, with the protocol's noise.
"""

from __future__ import annotations

import json
import multiprocessing
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from functools import lru_cache, partial
from pathlib import Path

from robust6dof.data.dataset import Dataset
from robust6dof.data.truth_file import open_with_truth
from robust6dof.errors import InputError
from robust6dof.evaluation.follow import MakeTracker, estimate_sequence, predict_sequence
from robust6dof.evaluation.frame_choice import FrameChoice
from robust6dof.evaluation.protocols import find_protocol
from robust6dof.evaluation.run_info import RunInfo


def predict(
    make_tracker: MakeTracker,
    info: RunInfo,
    out: Path,
    sequences: Sequence[str] = (),
    processes: int = 1,
    shard: tuple[int, int] = (0, 1),
) -> Iterator[str]:
    """Follow every object of every sequence; yields the name of each sequence when it is done.

    Sequences that are finished in `out` are skipped, so that a run can be taken up again, or
    shared out over machines by `shard`.

    Args:
        make_tracker: makes the tracker of one object.
        info: what the run is, and is known again by.
        out: its folder.
        sequences: only these; all if empty.
        processes: at the same time.
        shard: (i, n): each n-th sequence from the i-th on.

    Raises:
        DataError: the data set cannot be read.
        InputError: `out` holds a run with another tracker, protocol, data set or seed.
    """
    find_protocol(info.protocol)
    _claim(out, info)
    dataset = _dataset(info.data, info.frames, info.protocol)
    names = list(sequences) or [sequence.name for sequence in dataset.sequences]
    names = [dataset.sequence(name).name for name in names][shard[0] :: shard[1]]
    pending = [name for name in names if not (out / name / "done.json").is_file()]
    job = partial(_predict_named, make_tracker=make_tracker, info=info, out=out)
    if processes <= 1 or len(pending) <= 1:
        yield from map(job, pending)
        return
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(processes, mp_context=spawn) as pool:
        yield from pool.map(job, pending)


def _claim(out: Path, info: RunInfo) -> None:
    """Make the folder this run's; one in which nothing was stored yet is free to take."""
    path = out / "run.json"
    if path.is_file() and any(other != path for other in out.iterdir()):
        there = json.loads(path.read_text())
        if there != asdict(info):
            raise InputError(f"{out} holds another run ({there}); name another folder")
        return
    out.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(asdict(info), indent=1) + "\n")


@lru_cache(maxsize=1)
def _dataset(path: str, frames: FrameChoice, protocol: str) -> Dataset:
    return frames.of(find_protocol(protocol).truth(open_with_truth(path)))


def _predict_named(name: str, make_tracker: MakeTracker, info: RunInfo, out: Path) -> str:
    sequence = _dataset(info.data, info.frames, info.protocol).sequence(name)
    follow = estimate_sequence if info.single_view else predict_sequence
    outcome = follow(sequence, make_tracker, info, out / name)
    (out / name).mkdir(parents=True, exist_ok=True)
    (out / name / "done.json").write_text(json.dumps(asdict(outcome), indent=1) + "\n")
    return name
