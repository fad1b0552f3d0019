"""First loop: run a tracker over a data set and store its poses. Nothing is scored here.

    RUN/run.json                              what made it
    RUN/<sequence>/<object>/track.jsonl       one line a frame: pose, extents, state, ms
    RUN/<sequence>/done.json                  the sequence is finished

Truth reaches the tracker on its first frame only, with the protocol's noise.
"""

from __future__ import annotations

import json
import multiprocessing
import time
import zlib
from collections.abc import Callable, Iterable, Iterator, Sequence, Set
from concurrent.futures import ProcessPoolExecutor
from contextlib import ExitStack
from dataclasses import asdict, dataclass, replace
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np

from robust6dof.data.dataset import Dataset, DatasetSequence, ObjectTruth
from robust6dof.data.track_file import TrackWriter
from robust6dof.data.truth_file import open_with_truth
from robust6dof.errors import InputError, Robust6dofError
from robust6dof.evaluation.protocols import Protocol, find_protocol
from robust6dof.frames import RgbdFrame, Track

MIN_START_VISIBILITY = 0.1
"""A track starts on the first frame in which this share of the object is in view."""

MakeTracker = Callable[[str], Any]
"""Category → a PoseTracker; picklable (a function or a partial of one) for several workers."""


@dataclass(frozen=True)
class RunInfo:
    """What `run.json` says."""

    tracker: str
    protocol: str
    data: str
    seed: int


@dataclass(frozen=True)
class SequenceOutcome:
    """What `done.json` says."""

    frames: int
    seconds: float
    started: dict[str, str]
    """Object → name of its first frame."""
    failed: dict[str, str]
    """Object → why its tracker could not start; all its frames are missing."""


def predict(
    make_tracker: MakeTracker,
    info: RunInfo,
    out: Path,
    sequences: Sequence[str] = (),
    workers: int = 1,
) -> Iterator[str]:
    """Follow every object of every sequence; yields the name of each sequence when it is done.

    Sequences that are finished in `out` are skipped, so that a run can be taken up again, or
    shared out over machines by `sequences`.

    Raises:
        DataError: the data set cannot be read.
        InputError: `out` holds a run with another tracker, protocol, data set or seed.
    """
    find_protocol(info.protocol)
    _claim(out, info)
    dataset = open_with_truth(info.data)
    names = list(sequences) or [sequence.name for sequence in dataset.sequences]
    names = [dataset.sequence(name).name for name in names]
    pending = [name for name in names if not (out / name / "done.json").is_file()]
    job = partial(_predict_named, make_tracker=make_tracker, info=info, out=out)
    if workers <= 1 or len(pending) <= 1:
        yield from map(job, pending)
        return
    spawn = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(workers, mp_context=spawn) as pool:
        yield from pool.map(job, pending)


def _claim(out: Path, info: RunInfo) -> None:
    path = out / "run.json"
    if path.is_file():
        there = json.loads(path.read_text())
        if there != asdict(info):
            raise InputError(f"{out} holds another run ({there}); name another folder")
        return
    out.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(asdict(info), indent=1) + "\n")


@lru_cache(maxsize=1)
def _dataset(path: str) -> Dataset:
    return open_with_truth(path)


def _predict_named(name: str, make_tracker: MakeTracker, info: RunInfo, out: Path) -> str:
    sequence = _dataset(info.data).sequence(name)
    protocol = find_protocol(info.protocol)
    outcome = predict_sequence(sequence, make_tracker, protocol, out / name, info.seed)
    (out / name).mkdir(parents=True, exist_ok=True)
    (out / name / "done.json").write_text(json.dumps(asdict(outcome), indent=1) + "\n")
    return name


def predict_sequence(
    sequence: DatasetSequence,
    make_tracker: MakeTracker,
    protocol: Protocol,
    out: Path,
    seed: int = 0,
) -> SequenceOutcome:
    """Follow each object from the first frame that shows it to the end of the sequence.

    Raises:
        DataError: an unreadable frame.
        InputError: there is no such tracker, or none for such a category.
    """
    began = time.perf_counter()
    following: dict[str, Follower] = {}
    failed: dict[str, str] = {}
    with ExitStack() as files:
        for index in range(len(sequence)):
            frame = replace(sequence.frame(index), name=sequence.frame_names[index])
            for follower in following.values():
                follower.step(frame)
            for truth in _showing(sequence.truth(index), following.keys() | failed.keys()):
                key = zlib.crc32(f"{sequence.name}/{truth.name}".encode())
                rng = np.random.default_rng([seed, key])
                tracker = make_tracker(truth.category)
                try:
                    follower = Follower.start(tracker, protocol, frame, truth, rng)
                except Robust6dofError as error:
                    failed[truth.name] = str(error)
                    continue
                writer = files.enter_context(TrackWriter(out / truth.name / "track.jsonl"))
                follower.store_in(writer)
                following[truth.name] = follower
    started = {name: follower.first_frame for name, follower in following.items()}
    return SequenceOutcome(len(sequence), time.perf_counter() - began, started, failed)


def _showing(truths: Iterable[ObjectTruth], known: Set[str]) -> list[ObjectTruth]:
    """The objects not yet known that are visible enough, and have a mask where masks exist."""
    return [
        truth
        for truth in truths
        if truth.name not in known
        and (truth.visible_fraction is None or truth.visible_fraction >= MIN_START_VISIBILITY)
        and (truth.mask is None or truth.mask.any())
    ]


@dataclass
class Follower:
    """One object being followed through one sequence, and its growing file."""

    tracker: Any
    track: Track
    first_frame: str
    ms: float
    """Time of the latest step [ms]."""
    writer: TrackWriter | None = None

    @staticmethod
    def start(
        tracker: Any,
        protocol: Protocol,
        frame: RgbdFrame,
        truth: ObjectTruth,
        rng: np.random.Generator,
    ) -> Follower:
        """Begin with the mask and the protocol's start; the truth goes no further than here."""
        T_cam_obj, extents = protocol.start(truth.T_cam_box, truth.extents, rng)
        began = time.perf_counter()
        track = tracker.start(frame, mask=truth.mask, T_cam_obj=T_cam_obj, extents=extents)
        ms = 1000 * (time.perf_counter() - began)
        return Follower(tracker, replace(track, object_name=truth.name), frame.name, ms)

    def store_in(self, writer: TrackWriter) -> None:
        """Write the first pose, and every later one as it comes."""
        self.writer = writer
        writer.write(self.first_frame, self.track, self.ms)

    def step(self, frame: RgbdFrame) -> None:
        began = time.perf_counter()
        self.track = self.tracker.step(self.track, frame)
        self.ms = 1000 * (time.perf_counter() - began)
        if self.writer is not None:
            self.writer.write(frame.name, self.track, self.ms)
