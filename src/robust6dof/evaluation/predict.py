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

import numpy as np

from robust6dof.data.dataset import Dataset, DatasetSequence, ObjectTruth
from robust6dof.data.track_file import TrackWriter
from robust6dof.data.truth_file import open_with_truth
from robust6dof.errors import InputError, Robust6dofError
from robust6dof.evaluation.cad_models import find_cad_mesh
from robust6dof.evaluation.frame_choice import FrameChoice
from robust6dof.evaluation.protocols import Protocol, find_protocol
from robust6dof.evaluation.start_noise import PoseNoiseTracker
from robust6dof.frames import PoseTracker, RgbdFrame, Track

MIN_START_VISIBILITY = 0.1
"""A track starts on the first frame in which this share of the object is in view."""

MakeTracker = Callable[..., PoseTracker]
"""(category, cad=…) → a tracker; picklable (a function or a partial of one) for several workers.
`cad` gives the object's mesh to the trackers that are allowed one."""


@dataclass(frozen=True)
class RunInfo:
    """What `run.json` says."""

    tracker: str
    protocol: str
    data: str
    seed: int
    weights: str = ""
    """File of the network's weights; empty where there is none, or the shipped ones."""
    remark: str = ""
    """What must be said beside the figures."""
    meshes: str = ""
    """Folder with the meshes that were given to a tracker that is given one."""
    every: int = 1
    drop: int = 0
    most: int | None = None
    """See `FrameChoice`."""
    init_noise: float = 0.0
    """n of the paper's Init×n: further noise on the first pose."""
    all_noise: float = 0.0
    """n of its All×n: noise on every pose that the tracker steps from."""

    @property
    def frames(self) -> FrameChoice:
        """Which frames were shown."""
        return FrameChoice(self.every, self.drop, self.most)


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
    dataset = _dataset(info.data, info.frames)
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
    path = out / "run.json"
    if path.is_file():
        there = json.loads(path.read_text())
        if there != asdict(info):
            raise InputError(f"{out} holds another run ({there}); name another folder")
        return
    out.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(asdict(info), indent=1) + "\n")


@lru_cache(maxsize=1)
def _dataset(path: str, frames: FrameChoice) -> Dataset:
    return frames.of(open_with_truth(path))


def _predict_named(name: str, make_tracker: MakeTracker, info: RunInfo, out: Path) -> str:
    sequence = _dataset(info.data, info.frames).sequence(name)
    outcome = predict_sequence(sequence, make_tracker, info, out / name)
    (out / name).mkdir(parents=True, exist_ok=True)
    (out / name / "done.json").write_text(json.dumps(asdict(outcome), indent=1) + "\n")
    return name


def predict_sequence(
    sequence: DatasetSequence,
    make_tracker: MakeTracker,
    info: RunInfo,
    out: Path,
) -> SequenceOutcome:
    """Follow each object from the first frame that shows it to the end of the sequence.

    Raises:
        DataError: an unreadable frame.
        InputError: there is no such tracker, or none for such a category.
    """
    began = time.perf_counter()
    protocol = find_protocol(info.protocol)
    following: dict[str, Follower] = {}
    failed: dict[str, str] = {}
    with ExitStack() as files:
        for index in range(len(sequence)):
            frame = replace(sequence.frame(index), name=sequence.frame_names[index])
            for follower in following.values():
                follower.step(frame)
            for truth in _showing(sequence.truth(index), following.keys() | failed.keys()):
                key = zlib.crc32(f"{sequence.name}/{truth.name}".encode())
                rng = np.random.default_rng([info.seed, key])
                tracker = _tracker(make_tracker, info, sequence, truth, rng)
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


def _tracker(
    make_tracker: MakeTracker,
    info: RunInfo,
    sequence: DatasetSequence,
    truth: ObjectTruth,
    rng: np.random.Generator,
) -> PoseTracker:
    """The tracker for one object, with the noise that the run asks for."""
    root = Path(info.data)
    folders = ((Path(info.meshes),) if info.meshes else ()) + (root / "models", root / "meshes")
    tracker = make_tracker(truth.category, cad=partial(find_cad_mesh, sequence, truth, folders))
    if info.init_noise or info.all_noise:
        return PoseNoiseTracker(tracker, rng.spawn(1)[0], info.init_noise, info.all_noise)
    return tracker


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

    tracker: PoseTracker
    track: Track
    first_frame: str
    ms: float
    """Time of the latest step [ms]."""
    writer: TrackWriter | None = None

    @staticmethod
    def start(
        tracker: PoseTracker,
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
