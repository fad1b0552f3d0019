"""One sequence: its objects followed from their first frame, or estimated frame by frame."""

from __future__ import annotations

import time
import zlib
from collections.abc import Callable, Iterable, Set
from contextlib import ExitStack
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from robust6dof.data.dataset import DatasetSequence, ObjectTruth
from robust6dof.data.track_file import TrackWriter
from robust6dof.errors import Robust6dofError
from robust6dof.evaluation.cad_models import find_cad_mesh
from robust6dof.evaluation.protocols import Protocol, find_protocol
from robust6dof.evaluation.run_info import RunInfo, SequenceOutcome
from robust6dof.evaluation.start_noise import PoseNoiseTracker, exact
from robust6dof.evaluation.ycb_axes import YcbVideoAxes, upright_mesh
from robust6dof.frames import YCB_OBJECTS, PoseTracker, RgbdFrame, Track

MIN_START_VISIBILITY = 0.1
"""A track starts on the first frame in which this share of the object is in view."""

MakeTracker = Callable[..., PoseTracker]
"""(category, cad=…, exact_start=…) → a tracker; picklable (a function or a partial of one) for
several workers. `cad` gives the object's mesh to the trackers that are allowed one; `exact_start`
says that the protocol starts from the true pose."""


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


def estimate_sequence(
    sequence: DatasetSequence, make_tracker: MakeTracker, info: RunInfo, out: Path
) -> SequenceOutcome:
    """Estimate each object in each frame anew, from its mask alone (the detection) and no pose.

    Raises:
        DataError: an unreadable frame.
        InputError: there is no such tracker, or none for such a category.
    """
    began = time.perf_counter()
    trackers: dict[str, PoseTracker] = {}
    writers: dict[str, TrackWriter] = {}
    failed: dict[str, str] = {}
    rng = np.random.default_rng(info.seed)
    with ExitStack() as files:
        for index in range(len(sequence)):
            frame = replace(sequence.frame(index), name=sequence.frame_names[index])
            for truth in _showing(sequence.truth(index), set()):
                if truth.name not in trackers:
                    trackers[truth.name] = _tracker(make_tracker, info, sequence, truth, rng)
                    writer = TrackWriter(out / truth.name / "track.jsonl")
                    writers[truth.name] = files.enter_context(writer)
                started = time.perf_counter()
                try:
                    track = trackers[truth.name].start(frame, mask=truth.mask)
                except Robust6dofError as error:
                    failed[truth.name] = f"{frame.name}: {error}"
                    continue
                ms = 1000 * (time.perf_counter() - started)
                track = replace(track, object_name=truth.name, memory=None)
                writers[truth.name].write(frame.name, track, ms)
    return SequenceOutcome(len(sequence), time.perf_counter() - began, {}, failed)


def _tracker(
    make_tracker: MakeTracker,
    info: RunInfo,
    sequence: DatasetSequence,
    truth: ObjectTruth,
    rng: np.random.Generator,
) -> PoseTracker:
    """The tracker for one object, in the data's axes, with the noise that the run asks for."""
    root = Path(info.data)
    folders = ((Path(info.meshes),) if info.meshes else ()) + (root / "models", root / "meshes")
    exact_start = find_protocol(info.protocol).start is exact and not info.init_noise
    cad = partial(find_cad_mesh, sequence, truth, folders)
    if truth.category in YCB_OBJECTS:
        upright = partial(upright_mesh, cad)
        tracker: PoseTracker = YcbVideoAxes(
            make_tracker(truth.category, cad=upright, exact_start=exact_start)
        )
    else:
        tracker = make_tracker(truth.category, cad=cad, exact_start=exact_start)
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
