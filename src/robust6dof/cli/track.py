"""Follow an object through an RGB-D recording.

Writes track.jsonl (one pose a line), ob_in_cam/ (one 4×4 text file a frame) and overlay.mp4.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from robust6dof.cli.options import CommonOptions

if TYPE_CHECKING:
    import numpy as np

    from robust6dof.data.video import Video
    from robust6dof.frames import Box, PoseTracker, RgbdFrame, Track


@dataclass(frozen=True, kw_only=True)
class Options(CommonOptions):
    video: Annotated[Path, tyro.conf.Positional]
    """Folder of the recording (rgb/, depth/, cam_K.txt; or the layout of 7-Scenes)."""
    category: str
    """What the object is: bottle, bowl, camera, can, laptop, mug, or one that you built a prior of
    (robust6dof priors)."""
    out: Path
    """Folder for the results."""
    tracker: str = "robust6dof"
    """Which tracker: robust6dof, keypoints, icp, features, static."""
    weights: Path | None = None
    """Weights (.safetensors) of the network's trackers; the shipped ones if not given."""
    mask: Path | None = None
    """Image of the object's pixels in the first frame (not zero: object)."""
    box: str | None = None
    """Image box around the object in the first frame: x,y,width,height in pixels."""
    start: Path | None = None
    """Text file with the first frame's 4×4 T_cam_obj [m]."""
    extents: str | None = None
    """Side lengths of the object's box in metres: x,y,z; estimated when not given."""
    first: int = 0
    """Number of the first frame to use, counted from 0."""
    last: int | None = None
    """Number of the last frame to use."""
    every: int = 1
    """Use each n-th frame."""
    depth_only: bool = False
    """Use depth alone, for recordings whose colour is not registered to it."""
    fps: float | None = None
    """Frame rate of the recording [Hz], where it has no time stamps."""
    no_video: Annotated[bool, tyro.conf.FlagCreatePairsOff] = field(default=False)
    """Do not write overlay.mp4."""


def run(options: Options) -> None:
    """Track, write, and say how it went.

    Raises:
        InputError: options that contradict each other, no start.
        DataError: an unusable recording or file.
    """
    from robust6dof.baselines.registry import make_tracker
    from robust6dof.data import read_video

    tracker = make_tracker(
        options.tracker,
        options.category,
        seed=options.seed,
        weights=options.weights,
        device=options.device,
    )
    video = _frame_range(
        read_video(options.video, fps=options.fps, depth_only=options.depth_only), options
    )
    tracks = _follow(tracker, video, options)
    print(_summary(tracks, options.out))


@dataclass(frozen=True, eq=False)
class _Step:
    track: Track
    ms: float


def _follow(tracker: PoseTracker, video: Video, options: Options) -> list[_Step]:
    """Every frame in turn; an interruption keeps what was done."""
    from time import perf_counter

    from tqdm import tqdm

    steps: list[_Step] = []
    with _Output(options.out, video, write_video=not options.no_video) as output:
        try:
            for frame in tqdm(video, desc="tracking", unit="frame", mininterval=0.5):
                began = perf_counter()
                if steps:
                    track = tracker.step(steps[-1].track, frame)
                else:
                    track = tracker.start(frame, **_hints(options, frame))
                steps.append(_Step(track, 1e3 * (perf_counter() - began)))
                output.write(frame, steps[-1])
        except KeyboardInterrupt:
            print(_summary(steps, options.out))
            raise
    return steps


class _Output:
    """track.jsonl, ob_in_cam/ and overlay.mp4 of one object."""

    def __init__(self, folder: Path, video: Video, *, write_video: bool) -> None:
        from robust6dof.data.track_file import TrackWriter
        from robust6dof.visualization.video import VideoWriter

        self._folder = folder
        self._tracks = TrackWriter(folder / "track.jsonl")
        self._video = VideoWriter(folder / "overlay.mp4", _rate(video)) if write_video else None

    def write(self, frame: RgbdFrame, step: _Step) -> None:
        from robust6dof.data.track_file import write_ob_in_cam

        self._tracks.write(frame.name, step.track, step.ms)
        write_ob_in_cam(self._folder / "ob_in_cam", frame.name, step.track.T_cam_obj)
        if self._video is not None:
            self._video.write(_drawn(frame, step.track))

    def __enter__(self) -> _Output:
        return self

    def __exit__(self, *_: object) -> None:
        self._tracks.close()
        if self._video is not None:
            self._video.close()


def _drawn(frame: RgbdFrame, track: Track) -> np.ndarray:
    from robust6dof.visualization.overlay import colorize_depth, draw_box_and_axes, draw_label

    image = frame.rgb if frame.has_color else colorize_depth(frame.depth)
    image = draw_box_and_axes(image, frame.K, track.T_cam_obj, track.extents)
    return draw_label(
        image, f"{frame.name}  {track.category}  {track.state}  {track.confidence:.2f}"
    )


def _frame_range(video: Video, options: Options) -> Video:
    from robust6dof.errors import InputError

    if options.every < 1 or options.first < 0:
        raise InputError("--every counts from 1 and --first from 0")
    last = len(video) - 1 if options.last is None else options.last
    part = video[options.first : last + 1 : options.every]
    if not len(part):
        raise InputError(
            f"no frames from --first {options.first} to --last {last}; the recording has "
            f"{len(video)}"
        )
    return part


def _hints(options: Options, frame: RgbdFrame) -> dict[str, Any]:
    """Arguments of `start`: at most one of mask, box and pose; the extents with any of them."""
    from robust6dof.data.image_files import read_mask, read_transform
    from robust6dof.errors import InputError

    given = [name for name in ("mask", "box", "start") if getattr(options, name) is not None]
    if len(given) > 1:
        raise InputError(f"give only one of --{' and --'.join(given)}")
    hints: dict[str, Any] = {}
    if options.mask is not None:
        hints["mask"] = read_mask(options.mask)
    if options.box is not None:
        hints["box"] = _read_box(options.box)
    if options.start is not None:
        hints["T_cam_obj"] = read_transform(options.start)
    if options.extents is not None:
        import numpy as np

        hints["extents"] = np.array(_numbers(options.extents, 3, "--extents x,y,z"))
    return hints


def _read_box(text: str) -> Box:
    from robust6dof.frames import Box

    return Box(*_numbers(text, 4, "--box x,y,width,height"))


def _numbers(text: str, count: int, form: str) -> list[float]:
    from robust6dof.errors import InputError

    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != count:
        raise InputError(f"'{text}' does not read {form}")
    return numbers


def _rate(video: Video) -> float:
    """Frames per second by the stamps; 20 where there are none."""
    if len(video) > 1 and video.stamps[0] is not None and video.stamps[-1] is not None:
        span = video.stamps[-1] - video.stamps[0]
        if span > 0:
            return min(max((len(video) - 1) / span, 1.0), 120.0)
    return 20.0


def _summary(steps: list[_Step], out: Path) -> str:
    from collections import Counter
    from statistics import median

    if not steps:
        return "nothing was tracked"
    states = Counter(str(step.track.state) for step in steps)
    counts = ", ".join(f"{count} {state}" for state, count in states.most_common())
    mean = sum(step.track.confidence for step in steps) / len(steps)
    return (
        f"{len(steps)} frames: {counts}; mean confidence {mean:.2f}; "
        f"{median(step.ms for step in steps):.1f} ms a frame (median); results in {out}"
    )
