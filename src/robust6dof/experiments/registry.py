"""Every experiment of the paper by name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from robust6dof.errors import InputError
from robust6dof.experiments import ablations, benchmarks, online, qualitative, robustness
from robust6dof.experiments.report import Report
from robust6dof.experiments.setting import Setting


@dataclass(frozen=True)
class Experiment:
    """One table or figure of the paper."""

    run: Callable[[Setting], Report]
    paper: str
    """What of the paper it makes, by its LaTeX label."""


EXPERIMENTS = {
    "estimation": Experiment(benchmarks.estimation, "table_nocs-estimation, fig-map"),
    "tracking": Experiment(benchmarks.tracking, "table_nocs-tracking"),
    "ycb-video": Experiment(benchmarks.ycb_video, "table_ycb_video_compare"),
    "ycbineoat": Experiment(benchmarks.ycbineoat, "table_ycbineoat_compare"),
    "wild6d": Experiment(benchmarks.wild6d, "table_wild6d"),
    "speed": Experiment(robustness.speed, "table_FPS"),
    "dropped-frames": Experiment(robustness.dropped_frames, "fig-sta"),
    "pose-noise": Experiment(robustness.pose_noise, "fig-rob, ablation-noise"),
    "keypoint-count": Experiment(ablations.keypoint_count, "fig-sen"),
    "component-ablation": Experiment(ablations.components, "ablation-components"),
    "keypoint-ablation": Experiment(ablations.keypoint_manners, "ablation-keypoints"),
    "loss-ablation": Experiment(ablations.losses, "ablation-loss"),
    "qualitative": Experiment(
        qualitative.qualitative, "FIG_show_nocs, _ycb-video, _ycbineoat, _wild6d"
    ),
    "losses": Experiment(online.losses, "beyond the paper"),
    "calibration": Experiment(online.calibration, "beyond the paper"),
    "drift": Experiment(online.drift, "beyond the paper"),
}


def find_experiment(name: str) -> Experiment:
    """The experiment of that name.

    Raises:
        InputError: there is none; the message lists what there is.
    """
    if name not in EXPERIMENTS:
        raise InputError(f"no experiment '{name}'; there is: {', '.join(EXPERIMENTS)}")
    return EXPERIMENTS[name]
