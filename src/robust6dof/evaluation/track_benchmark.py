"""How fast the tracker is end to end: from an image to a pose."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, TypeVar

import numpy as np
import torch

from robust6dof.frames import RgbdFrame, Track
from robust6dof.shapes.procedural import make_object
from robust6dof.synthetic.plans import FIRST_TEST_SHAPE
from robust6dof.synthetic.sequence import SyntheticSequence
from robust6dof.tracking.encoder import ViewEncoder
from robust6dof.tracking.surface.icp import IcpTracker
from robust6dof.tracking.tracker import Tracker
from robust6dof.tracking.tracker_memory import TrackerMemory
from robust6dof.tracking.view import ViewConfig, make_view

Result = TypeVar("Result")


@dataclass(frozen=True)
class TrackBenchmark:
    """Times of one object followed through one agile recording; times in milliseconds."""

    category: str
    frames: int
    parameters: int
    points: int
    keypoints: int
    device: str
    threads: int
    step_ms: float
    """Median time of a step: image in, pose out."""
    step_ms_p95: float
    """95th percentile."""
    stages_ms: dict[str, float]
    """Median of each part run by itself on the same frames: `crop`, `network` (crop left out),
    `matching` (with the last frame; a step needs it only where the registration fails), `solve`
    (the anchor), `registration`."""


def benchmark_track(encoder: ViewEncoder, frames: int = 60, seed: int = 0) -> TrackBenchmark:
    """Follow a procedural test object, started from its true pose; threads are torch's."""
    target = make_object(encoder.category, FIRST_TEST_SHAPE + seed)
    sequence = SyntheticSequence.draw(target, "agile", seed, frames)
    shots = [sequence.frame(index) for index in range(len(sequence))]
    images = [frame for frame, _ in shots]
    tracker = Tracker(encoder)
    truth = shots[0][1]
    track = tracker.start(images[0], T_cam_obj=truth.T_cam_obj, extents=truth.extents)
    tracks, times = [track], []
    for frame in images[1:]:
        begun = time.perf_counter()
        track = tracker.step(track, frame)
        times.append(1e3 * (time.perf_counter() - begun))
        tracks.append(track)
    net = encoder.net
    return TrackBenchmark(
        category=encoder.category,
        frames=len(times),
        parameters=sum(p.numel() for p in net.parameters()),
        points=net.config.points,
        keypoints=net.config.keypoints,
        device=torch.cuda.get_device_name() if _on_gpu(encoder) else "cpu",
        threads=torch.get_num_threads(),
        step_ms=float(np.median(times)),
        step_ms_p95=float(np.percentile(times, 95)),
        stages_ms=_stages(encoder, images, tracks),
    )


def _stages(encoder: ViewEncoder, images: list[RgbdFrame], tracks: list[Track]) -> dict[str, float]:
    """Each part by itself, on every frame after the first."""
    config = ViewConfig(points=encoder.net.config.points, crop_px=encoder.net.config.crop_px)
    icp = IcpTracker(encoder.category, seed=encoder.seed)
    on_gpu = _on_gpu(encoder)
    times: dict[str, list[float]] = {}

    def timed(name: str, part: Callable[..., Result], *arguments: Any) -> Result:
        begun = time.perf_counter()
        result = part(*arguments)
        if on_gpu:
            torch.cuda.synchronize()
        times.setdefault(name, []).append(1e3 * (time.perf_counter() - begun))
        return result

    for number, (frame, last) in enumerate(zip(images[1:], tracks[:-1], strict=True), 1):
        memory: TrackerMemory = last.memory
        T, extents, past = last.T_cam_obj, last.extents, memory.last.features
        rng = np.random.default_rng(number)
        timed("crop", make_view, frame, T, extents, config, rng)
        features = timed("whole", encoder.encode, frame, T, extents, past, number)
        timed("registration", icp.step, memory.surface, frame)
        if features is not None:
            with torch.inference_mode():
                timed("matching", encoder.net.match, past, features)
            timed("solve", encoder.anchor, features, number)
    median = {name: float(np.median(values)) for name, values in times.items()}
    median["network"] = median.pop("whole") - median["crop"]
    return median


def _on_gpu(encoder: ViewEncoder) -> bool:
    return next(encoder.net.parameters()).is_cuda
