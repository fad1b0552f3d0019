"""How good the network is on pairs of shapes that it never trained on."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np
import torch

from robust6dof.geometry.differentiable_alignment import fit_rigid_torch, fit_similarity_torch
from robust6dof.geometry.transforms import axis_error, rotation_error
from robust6dof.network.robust6dof_net import PairOutput, Robust6DofNet
from robust6dof.training.pair_batch import PairBatch
from robust6dof.training.targets import PairTruth


@torch.no_grad()
def validate(net: Robust6DofNet, batches: Iterable[PairBatch]) -> dict[str, float]:
    """Shares and medians over all pairs; symmetric objects by their axis.

    `anchor_*`: the absolute single-view estimate. `step_*`: the change between the views alone.
    `start_*`: the prediction that the network was given, to compare with. `5deg5cm` are
    percentages; `deg`, `cm` are medians.
    """
    net.eval()
    errors: dict[str, list[np.ndarray]] = {"anchor": [], "step": [], "start": []}
    for batch in batches:
        output = net(batch.previous, batch.current, batch.prior)
        errors["anchor"].append(_absolute_errors(*_anchor(output), batch.truth))
        start = output.current.T_cam_pred
        errors["start"].append(_absolute_errors(start[:, :3, :3], start[:, :3, 3], batch.truth))
        errors["step"].append(_step_errors(output, batch.truth))
    net.train()
    scores: dict[str, float] = {}
    for name, parts in errors.items():
        deg, cm = np.concatenate(parts).T
        scores[f"{name}_5deg5cm"] = 100.0 * float(np.mean((deg <= 5) & (cm <= 5)))
        scores[f"{name}_deg"] = float(np.median(deg))
        scores[f"{name}_cm"] = float(np.median(cm))
    return scores


def _anchor(output: PairOutput) -> tuple[torch.Tensor, torch.Tensor]:
    view = output.current
    R_fit, t_fit, _ = fit_similarity_torch(view.canonical, view.points, view.point_weight)
    R_cam_pred, t_cam_pred = view.T_cam_pred[:, :3, :3], view.T_cam_pred[:, :3, 3]
    t_cam_obj = (R_cam_pred @ t_fit[..., None])[..., 0] * view.scale[:, None] + t_cam_pred
    return R_cam_pred @ R_fit, t_cam_obj


def _step_errors(output: PairOutput, truth: PairTruth) -> np.ndarray:
    """The true previous pose moved by the estimated change, against the true current pose."""
    R_fit, t_fit = fit_rigid_torch(
        output.previous.keypoints_cam, output.current.keypoints_cam, output.matches.coarse_weight
    )
    T_prev = truth.T_cam_obj_prev
    R_cam_obj = R_fit @ T_prev[:, :3, :3]
    t_cam_obj = (R_fit @ T_prev[:, :3, 3:])[..., 0] + t_fit
    return _absolute_errors(R_cam_obj, t_cam_obj, truth)


def _absolute_errors(R: torch.Tensor, t: torch.Tensor, truth: PairTruth) -> np.ndarray:
    """[B, 2]: degrees and centimetres."""
    R_est, R_true = R.double().cpu().numpy(), truth.T_cam_obj_cur[:, :3, :3].double().cpu().numpy()
    symmetric = truth.symmetric.cpu().numpy()
    angle = np.where(symmetric, axis_error(R_est, R_true), rotation_error(R_est, R_true))
    distance = (t - truth.T_cam_obj_cur[:, :3, 3]).norm(dim=1).cpu().numpy()
    return np.stack([np.rad2deg(angle), 100.0 * distance], axis=1)
