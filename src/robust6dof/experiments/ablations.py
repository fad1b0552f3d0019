"""Number of keypoints, and the ablations, which train each row anew at a budget that is stated."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from robust6dof.evaluation.data_kind import data_kind
from robust6dof.experiments.budget import train_row
from robust6dof.experiments.figures import plot_curves, series_of
from robust6dof.experiments.report import Line, Report, line_of
from robust6dof.experiments.setting import Setting
from robust6dof.network.checkpoint import load_network, save_network
from robust6dof.network.robust6dof_net import Robust6DofNet
from robust6dof.tracking.pretrained import shipped_weights
from robust6dof.training.losses import LOSS_SETS, LossConfig

KEYPOINTS = (100, 200, 300, 400, 500, 600, 700, 800)
_COLUMNS = ("IoU25", "IoU50", "5deg2cm", "5deg5cm", "10deg5cm", "R_err_deg", "T_err_cm")


def keypoint_count(setting: Setting) -> Report:
    """The four measures against the number of keypoints; weights serve any number."""
    weights = setting.weights or shipped_weights()
    if weights is None:
        weights = train_row(setting, "M5", "M5", LossConfig(), setting.seed)
    lines, rows = [], []
    for count in KEYPOINTS:
        path = _with_keypoints(weights, count, setting.out / "weights" / f"n{count}")
        run = setting.predict("keypoints", "6pack", f"n{count}", weights=path)
        rows.append(setting.scores(run, "6pack"))
        lines.append(line_of(f"n = {count}", rows[-1]))
    figure = plot_curves(
        setting.out / "keypoint-count.png",
        KEYPOINTS,
        {
            "5°5cm": series_of(rows, "5deg5cm"),
            "IoU25": series_of(rows, "IoU25"),
            "R_err": replace(series_of(rows, "R_err_deg"), dashed=True),
            "T_err": replace(series_of(rows, "T_err_cm"), dashed=True),
        },
        "number of keypoints",
        "5°5cm, IoU25 [%]",
        "R_err [deg], T_err [cm]",
    )
    columns = ("5deg5cm", "IoU25", "R_err_deg", "T_err_cm")
    note = "with points as the network has them, but at least as many prior points as keypoints"
    return _report(setting, "Number of keypoints", columns, lines, (figure,), (note,))


def _with_keypoints(weights: Path, count: int, path: Path) -> Path:
    """The same weights with another number of keypoints."""
    net = load_network(weights)
    prior_points = max(net.config.prior_points, count)
    config = replace(net.config, keypoints=count, prior_points=prior_points)
    other = Robust6DofNet(config)
    other.load_state_dict(net.state_dict())
    return save_network(other, path)


def components(setting: Setting) -> Report:
    """Rows M0 to M5 of the paper."""
    rows = {name: (name, LossConfig()) for name in ("M0", "M1", "M2", "M3", "M4", "M5")}
    return _ablate(setting, "Ablation of components", rows)


def keypoint_manners(setting: Setting) -> Report:
    """Without prior guidance, without finer matching, unsupervised, and ours."""
    rows = {
        "without prior guidance": ("no-prior-guidance", LossConfig(auxiliary="off")),
        "without finer matching": ("no-finer-matching", LossConfig()),
        "unsupervised keypoints": ("unsupervised-keypoints", LossConfig(auxiliary="separation")),
        "ours": ("M5", LossConfig()),
    }
    return _ablate(setting, "Ablation of keypoints", rows)


def losses(setting: Setting) -> Report:
    """The paper's four sets of losses."""
    rows = {name: ("M5", config) for name, config in LOSS_SETS.items()}
    return _ablate(setting, "Ablation of losses", rows)


def _ablate(setting: Setting, title: str, rows: dict[str, tuple[str, LossConfig]]) -> Report:
    seeds = range(setting.seed, setting.seed + setting.trainings)
    weights: dict[str, list[Path]] = {label: [] for label in rows}
    for seed in seeds:
        for label, (name, loss) in rows.items():
            weights[label].append(train_row(setting, label, name, loss, seed))
    lines = [_row(setting, label, paths) for label, paths in weights.items()]
    note = (
        f"every row trained {setting.trainings} times for {setting.training_steps} steps of the "
        f"network '{setting.preset}', with the same pairs for all rows of one seed: a comparison "
        "at that budget, not of converged networks"
    )
    return _report(setting, title, _COLUMNS, lines, (), (note,))


def _row(setting: Setting, label: str, weights: list[Path]) -> Line:
    """IoU25, 5°5cm and errors of tracking; the others are AP of the same tracked poses.

    All trainings together, and 5°5cm of each.
    """
    runs = [setting.predict("keypoints", "6pack", p.parent.name, weights=p) for p in weights]
    tracked, detected = (setting.pooled_scores(runs, name) for name in ("6pack", "nocs-map"))
    values = detected.mean | tracked.mean
    interval = detected.details.get("interval95", {}) | tracked.details.get("interval95", {})
    each = [setting.scores(run, "6pack").mean["5deg5cm"] for run in runs]
    remark = f"5deg5cm of each training: {', '.join(f'{value:.1f}' for value in each)}"
    return Line(label, values, interval, remark if len(each) > 1 else "")


def _report(
    setting: Setting,
    title: str,
    columns: tuple[str, ...],
    lines: list[Line],
    figures: tuple[Path, ...],
    notes: tuple[str, ...],
) -> Report:
    more = (
        "IoU25, 5deg5cm, R_err and T_err by `6pack`; IoU50, 5deg2cm and 10deg5cm are AP of the "
        "same tracked poses by `nocs-map`",
    )
    data = data_kind(setting.dataset_path())
    return Report(
        title, data, columns, tuple(lines), figures, notes + more, "6pack", "nocs_official"
    )
