"""Follow an object through an RGB-D recording.

Writes track.jsonl (one pose a line), ob_in_cam/ (one 4×4 text file a frame) and overlay.mp4.
"""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import tyro

from robust6dof.cli.options import CommonOptions

if TYPE_CHECKING:
    import numpy as np

    from robust6dof.data.video import Video
    from robust6dof.frames import PoseTracker, RgbdFrame, Track
    from robust6dof.visualization.live_view import LiveView


@dataclass(frozen=True, kw_only=True)
class Options(CommonOptions):
    video: Annotated[Path, tyro.conf.Positional]
    """Folder of the recording (rgb/, depth/, cam_K.txt; or the layout of 7-Scenes)."""
    category: str = ""
    """What the object is: bottle, bowl, camera, can, laptop, mug, or one that you built a prior of
    (robust6dof priors)."""
    object: str = ""
    """Instead: one of YCB-Video's 21 objects, such as 006_mustard_bottle."""
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
    click: str | None = None
    """Pixel on the object in the first frame: x,y; for objects that stand on something."""
    start: Path | None = None
    """Text file with the first frame's 4×4 T_cam_obj [m]."""
    extents: str | None = None
    """Side lengths of the object's box in metres: x,y,z; estimated when not given."""
    segmenter: Literal["depth", "mask-rcnn"] = "depth"
    """What finds the object from a click or from the category alone: depth (what stands on a
    plane), or mask-rcnn (needs --segmenter-weights)."""
    segmenter_weights: Path | None = None
    """Weights of mask-rcnn: FILE.onnx (extra segmenter) or FILE.pt (extra segmenter-training)."""
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
    record: Path | None = None
    """Write a rerun timeline, FILE.rrd, too (extra rerun)."""
    view: Annotated[bool, tyro.conf.FlagCreatePairsOff] = field(default=False)
    """Show it live in a browser page on this machine (extra viewer); Ctrl-C ends it."""
    view_port: int = 8080
    """Port of that page; the next free one where it is taken."""


def run(options: Options) -> None:
    """Track, write, and say how it went.

    Raises:
        InputError: options that contradict each other, no start.
        DataError: an unusable recording or file.
    """
    from robust6dof.baselines.registry import make_tracker
    from robust6dof.data import read_video
    from robust6dof.tracking.pretrained import category_or_object

    options = replace(options, category=category_or_object(options.category, options.object))
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
    with ExitStack() as stack:
        live = _live_view(options, stack)
        tracks = _follow(tracker, video, options, live)
        print(_summary(tracks, options.out))
        if live is not None:
            print(f"the last frame stays on {live.url} until Ctrl-C")
            live.wait()


def _live_view(options: Options, stack: ExitStack) -> LiveView | None:
    if not options.view:
        return None
    from robust6dof.visualization.live_view import LiveView

    live = stack.enter_context(LiveView(options.view_port))
    print(f"open {live.url} in a browser", flush=True)
    return live


@dataclass(frozen=True, eq=False)
class _Step:
    track: Track
    ms: float


def _follow(
    tracker: PoseTracker, video: Video, options: Options, live: LiveView | None
) -> list[_Step]:
    """Every frame in turn; an interruption keeps what was done."""
    from time import perf_counter

    from tqdm import tqdm

    from robust6dof.cli.start_hints import start_hints

    steps: list[_Step] = []
    with _Output(options, video, tracker, live) as output:
        try:
            for frame in tqdm(video, desc="tracking", unit="frame", mininterval=0.5):
                hints = {} if steps else start_hints(options, frame)
                began = perf_counter()
                if steps:
                    track = tracker.step(steps[-1].track, frame)
                else:
                    track = tracker.start(frame, **hints)
                before = steps[-1].track if steps else None
                steps.append(_Step(track, 1e3 * (perf_counter() - began)))
                output.write(frame, steps[-1], before)
        except KeyboardInterrupt:
            print(_summary(steps, options.out))
            raise
    return steps


class _Output(ExitStack):
    """track.jsonl, ob_in_cam/ and overlay.mp4 of one object, the timeline and the live page."""

    def __init__(
        self, options: Options, video: Video, tracker: PoseTracker, live: LiveView | None
    ) -> None:
        from robust6dof.data.track_file import TrackWriter

        super().__init__()
        self._folder, self._live, self._video, self._recorder = options.out, live, None, None
        self._net = getattr(tracker, "net", None)
        self._tracks = self.enter_context(TrackWriter(options.out / "track.jsonl"))
        if not options.no_video:
            from robust6dof.visualization.video import VideoWriter

            path = options.out / "overlay.mp4"
            self._video = self.enter_context(VideoWriter(path, _rate(video)))
        if options.record is not None:
            from robust6dof.visualization.rerun_recorder import RerunRecorder

            self._recorder = self.enter_context(RerunRecorder(options.record))

    def write(self, frame: RgbdFrame, step: _Step, before: Track | None) -> None:
        from robust6dof.data.track_file import write_ob_in_cam

        self._tracks.write(frame.name, step.track, step.ms)
        write_ob_in_cam(self._folder / "ob_in_cam", frame.name, step.track.T_cam_obj)
        if self._video is not None:
            self._video.write(_drawn(frame, step.track))
        if self._recorder is None and self._live is None:
            return
        from robust6dof.visualization.track_view import make_track_view

        view = make_track_view(frame, step.track, before, self._net, step.ms)
        if self._recorder is not None:
            self._recorder.write(view)
        if self._live is not None:
            self._live.show(view)


def _drawn(frame: RgbdFrame, track: Track) -> np.ndarray:
    from robust6dof.visualization.overlay import draw_box_and_axes, draw_label, frame_image

    image = draw_box_and_axes(frame_image(frame), frame.K, track.T_cam_obj, track.extents)
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
