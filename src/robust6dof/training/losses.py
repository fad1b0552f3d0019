"""The paper's five losses, and those of what goes beyond it: canonical anchor and foreground.

Lengths in diagonals of the object's box, angles in radians (see `targets`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float
from torch import Tensor

from robust6dof.errors import InputError
from robust6dof.geometry.differentiable_alignment import fit_rigid_torch, fit_similarity_torch
from robust6dof.network.inputs import ViewFeatures
from robust6dof.network.robust6dof_net import PairOutput
from robust6dof.training.targets import PairTargets, PairTruth, ViewTargets, make_targets


@dataclass(frozen=True)
class LossWeights:
    """Weight of each loss; 0 leaves it out (the paper's ablation of loss sets)."""

    rotation: float = 1.0
    """L_rot."""
    translation: float = 2.0
    """L_tra."""
    auxiliary: float = 2.0
    """L_aux."""
    consistency: float = 5.0
    """L_mvc."""
    matching: float = 0.3
    """L_c."""
    keypoint_error: float = 0.05
    """Likelihood of the keypoints' expected errors."""
    anchor: float = 5.0
    """Canonical coordinates against the true ones."""
    correspondence: float = 2.0
    """Soft places on the prior, S̄_pr P_r, against the true canonical coordinates."""
    anchor_error: float = 0.05
    """Likelihood of the coordinates' expected errors."""
    anchor_fit: float = 0.3
    """Absolute rotation, centre and scale fitted to the coordinates."""
    foreground: float = 0.3
    """Points on the object or not."""


@dataclass(frozen=True)
class LossConfig:
    """Readings of the losses."""

    weights: LossWeights = field(default_factory=LossWeights)
    auxiliary: Literal["correspondence", "literal", "separation", "off"] = "correspondence"
    """P_r^K = M S̄_pr P_r; or M P_r as printed (needs N = N_r); or 6-PACK's separation and
    silhouette terms, for unsupervised keypoints; or none (no prior guidance)."""
    auxiliary_in_view: bool = True
    """Ask only prior points in view for a near keypoint."""
    auxiliary_moves_correspondence: bool = False
    """Let L_aux send gradient into S̄_pr."""
    translation: Literal["printed", "exact", "solved"] = "solved"
    """L_tra as printed, or about the true rotation, or on the fitted change of the centre."""
    match_radius: float = 0.06
    """How near true matches must be, in diagonals."""
    view_radius: float = 0.1
    """How near an observed point a prior point in view is, in diagonals."""


LOSS_SETS: dict[str, LossConfig] = {
    "base": LossConfig(LossWeights(auxiliary=0.0, consistency=0.0, matching=0.0)),
    "base+aux": LossConfig(LossWeights(consistency=0.0, matching=0.0)),
    "base+aux+mvc": LossConfig(LossWeights(matching=0.0)),
    "all": LossConfig(),
}
"""The four rows of the paper's ablation of losses."""


def pair_losses(
    output: PairOutput, truth: PairTruth, config: LossConfig
) -> tuple[Float[Tensor, ""], dict[str, Float[Tensor, ""]]]:
    """The weighted sum, and each loss unweighted by the name of its weight.

    Raises:
        InputError: the literal L_aux with N ≠ N_r.
    """
    targets = make_targets(output, truth, config.match_radius, config.view_radius)
    weights = vars(config.weights)
    parts = {
        **_motion_losses(output, targets, config),
        **_view_losses(output, targets, config),
        "matching": matching_loss(output.matches.log_probability, targets.matches),
    }
    used = {name: value for name, value in parts.items() if weights[name] > 0}
    total = torch.stack([weights[name] * value for name, value in used.items()]).sum()
    return total, used


def _motion_losses(
    output: PairOutput, targets: PairTargets, config: LossConfig
) -> dict[str, Tensor]:
    """What is said of the change from the previous to the current view."""
    k_prev = targets.to_loss_axes(output.previous.keypoints_cam)
    k_cur = targets.to_loss_axes(output.current.keypoints_cam)
    moved = k_prev @ targets.R_cur_prev.mT + targets.t_cur_prev[:, None]
    R_fit, t_fit = fit_rigid_torch(k_prev, k_cur, output.matches.coarse_weight)
    if config.translation == "printed":
        error = (k_cur - k_prev).mean(1) - targets.t_cur_prev
    elif config.translation == "exact":
        error = (k_cur - moved).mean(1)
    else:  # the centre c is the origin of these axes
        error = t_fit - targets.t_cur_prev
    distance = safe_norm(k_cur - moved)
    expected = 0.5 * torch.logaddexp(
        2 * output.previous.keypoint_log_error, 2 * output.current.keypoint_log_error
    )
    return {
        "rotation": rotation_loss(R_fit, targets.R_cur_prev).mean(),
        "translation": safe_norm(error).mean(),
        "consistency": distance.mean(),
        "keypoint_error": expected_error_loss(distance, expected).mean(),
    }


def _view_losses(output: PairOutput, targets: PairTargets, config: LossConfig) -> dict[str, Tensor]:
    """What is said of each view alone, averaged over both."""
    prior = output.prior.points
    per_view = []
    for view, target in ((output.previous, targets.previous), (output.current, targets.current)):
        parts = _anchor_losses(view, target, targets.scale)
        parts["auxiliary"] = _auxiliary(view, prior, target.prior_in_view, config)
        parts["foreground"] = F.binary_cross_entropy_with_logits(
            view.foreground, target.on_object.to(view.foreground.dtype)
        )
        per_view.append(parts)
    return {name: 0.5 * (per_view[0][name] + per_view[1][name]) for name in per_view[0]}


def _anchor_losses(
    view: ViewFeatures, target: ViewTargets, scale: Float[Tensor, "B"]
) -> dict[str, Tensor]:
    on_object = target.on_object.to(view.canonical.dtype)
    distance = safe_norm(view.canonical - target.canonical)
    distance_place = safe_norm(view.correspondence - target.canonical)
    likelihood = expected_error_loss(distance, view.log_error)
    weight = view.point_weight * on_object + 1e-6
    R_fit, t_fit, scale_fit = fit_similarity_torch(view.canonical, view.points, weight)
    R_cam_pred, t_cam_pred = view.T_cam_pred[:, :3, :3], view.T_cam_pred[:, :3, 3]
    t_true = ((target.t_cam_obj - t_cam_pred)[:, None] @ R_cam_pred)[:, 0] / view.scale[:, None]
    log_scale = scale_fit.clamp_min(1e-3).log() - (scale / view.scale).log()
    fit = (
        rotation_loss(R_cam_pred @ R_fit, target.R_cam_obj)
        + 2.0 * safe_norm(t_fit - t_true)
        + log_scale.abs().clamp_max(2.0)
    )
    return {
        "anchor": masked_mean(distance, on_object),
        "correspondence": masked_mean(distance_place, on_object),
        "anchor_error": masked_mean(likelihood, on_object),
        "anchor_fit": (fit * target.on_object.any(1)).mean(),
    }


def _auxiliary(
    view: ViewFeatures, prior: Tensor, in_view: Tensor, config: LossConfig
) -> Float[Tensor, ""]:
    if config.auxiliary == "off":
        return prior.new_zeros(())
    if config.auxiliary == "separation":
        return separation_loss(view.keypoints) + silhouette_loss(view.keypoints, view.points)
    if config.auxiliary == "literal":
        if view.points.shape[1] != prior.shape[1]:
            raise InputError(
                f"the literal L_aux multiplies M by the prior: it needs as many prior points "
                f"({prior.shape[1]}) as observed points ({view.points.shape[1]})"
            )
        placed = view.assignment @ prior
    else:
        place = view.correspondence
        placed = view.assignment @ (
            place if config.auxiliary_moves_correspondence else place.detach()
        )
    mask = in_view if config.auxiliary_in_view else torch.ones_like(in_view)
    return auxiliary_loss(placed, prior, mask)


def auxiliary_loss(
    placed: Float[Tensor, "B K 3"], prior: Float[Tensor, "B Nr 3"], in_view: Bool[Tensor, "B Nr"]
) -> Float[Tensor, ""]:
    """L_aux: both Chamfer terms, each as a mean (printed: sums), the first over points in view."""
    square = torch.cdist(prior, placed, compute_mode="donot_use_mm_for_euclid_dist").square()
    return masked_mean(square.amin(2), in_view.to(square.dtype)) + square.amin(1).mean()


def matching_loss(
    log_probability: Float[Tensor, "B K L"], matches: Bool[Tensor, "B K L"]
) -> Float[Tensor, ""]:
    """L_c: the mean of −log P_c over the true matches; 0 where there is none."""
    return masked_mean(-log_probability, matches.to(log_probability.dtype))


def rotation_loss(R_fit: Float[Tensor, "B 3 3"], R_true: Float[Tensor, "B 3 3"]) -> Tensor:
    """L_rot = 2 arcsin(‖R − R_gt‖_F / 2√2) [B], the angle between them [rad].

    The norm's gradient is singular at 0 and arcsin's at π: both ends are clamped.
    """
    norm = ((R_fit - R_true).square().sum((-1, -2)) + 1e-8).sqrt()
    return 2.0 * torch.asin((norm / (2.0 * math.sqrt(2.0))).clamp_max(0.999))


def expected_error_loss(distance: Tensor, log_error: Tensor) -> Tensor:
    """−log likelihood of an error of the expected size (Laplace); teaches the expectation alone."""
    return distance.detach() * torch.exp(-log_error) + log_error


def separation_loss(keypoints: Float[Tensor, "B K 3"], least: float = 0.05) -> Float[Tensor, ""]:
    """6-PACK's separation: keypoints nearer than `least` to each other are pushed apart."""
    distance = torch.cdist(keypoints, keypoints, compute_mode="donot_use_mm_for_euclid_dist")
    apart = F.relu(least - distance).tril(-1)
    return apart.sum((1, 2)).mean() / keypoints.shape[1]


def silhouette_loss(
    keypoints: Float[Tensor, "B K 3"], points: Float[Tensor, "B N 3"]
) -> Float[Tensor, ""]:
    """6-PACK's silhouette: keypoints lie near the surface."""
    distance = torch.cdist(keypoints, points, compute_mode="donot_use_mm_for_euclid_dist")
    return distance.amin(2).mean()


def masked_mean(values: Tensor, mask: Tensor) -> Float[Tensor, ""]:
    """Mean over where mask is 1; 0 if nowhere."""
    return (values * mask).sum() / mask.sum().clamp_min(1.0)


def safe_norm(x: Tensor) -> Tensor:
    """Length over the last axis with a finite gradient at 0."""
    return (x.square().sum(-1) + 1e-12).sqrt()
