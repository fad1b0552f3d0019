"""Render the test videos of YCB-Video anew: their real trajectories, scanned shapes, our sensor.

Score a run on it with --protocol ycbv-auc, and never print it beside results on the real images
without saying so.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from robust6dof.cli.options import CommonOptions


@dataclass(frozen=True, kw_only=True)
class Options(CommonOptions):
    out: Path
    """Folder of the recordings; whole ones that are there already are kept."""
    poses: Path
    """Folder with ycbv_gt_poses_by_video.npz, ycbv_to_google16k_frame.json and models_points/."""
    meshes: Path
    """Folder with OBJECT/textured.obj or OBJECT/google_16k/textured.obj of the YCB objects."""
    videos: tuple[str, ...] = ()
    """Some of 0048 to 0059 (default: all)."""
    every: int = 1
    """Render each n-th frame; above 1 every frame counts in the scores, not the keyframes."""
    frames: int | None = None
    """At most so many of each video (default: all)."""
    processes: int = 1
    """Videos rendered at the same time."""


def run(options: Options) -> None:
    """Render what is not there yet."""
    from functools import partial

    from robust6dof.cli.make_all import make_all
    from robust6dof.synthetic.ycb_source import YcbSource, plan_ycb_video
    from robust6dof.synthetic.ycb_video import render_ycb_video, write_models

    source = YcbSource(options.poses, options.meshes)
    plans = plan_ycb_video(source, options.seed, options.videos, options.every, options.frames)
    options.out.mkdir(parents=True, exist_ok=True)
    write_models(plans, source, options.out)
    make = partial(render_ycb_video, source=source, out=options.out)
    make_all(make, plans, options.processes, "videos")
    print(f"{len(plans)} videos, {sum(len(p.frames) for p in plans)} frames: {options.out}")
