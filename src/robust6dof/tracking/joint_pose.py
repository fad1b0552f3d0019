"""One frame's pose from all that is known: the last frame, stored views, the canonical anchor."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch
from jaxtyping import Float

from robust6dof.errors import InputError
from robust6dof.geometry.camera import project
from robust6dof.geometry.transforms import (
    invert_transform,
    orientation_error,
    transform_points,
)
from robust6dof.network.inputs import ViewFeatures, to_camera
from robust6dof.network.matching import select_pairs
from robust6dof.network.robust6dof_net import Robust6DofNet
from robust6dof.solver.absolute import AbsoluteFit, fit_absolute
from robust6dof.solver.joint import PairBlock, fit_joint
from robust6dof.solver.pnp import ransac_pnp
from robust6dof.solver.rigid_ransac import ransac_rigid
from robust6dof.tracking.keyframes import Keyframe


@dataclass(frozen=True)
class JointPoseConfig:
    """How a frame is solved, and what each source of evidence counts."""

    solver: Literal["joint", "pnp"] = "joint"
    """All pairs together, weighted and robust; or, as printed, PnP and RANSAC on the last frame's
    3D keypoints and the current frame's pixels, which leaves the current depth unused."""
    inlier_px: float = 3.0
    """Of PnP."""
    hypotheses: int = 64
    """RANSAC samples."""
    last_weight: float = 1.0
    """Of the pairs with the last frame."""
    memory_weight: float = 1.0
    """Of the pairs with all stored views together."""
    anchor_weight: float = 1.0
    """Of the canonical anchor; 0 leaves it out (chained ΔP, as printed)."""
    stored_views: int = 3
    """How many stored views are matched."""
    robust_share: float = 0.04
    """Residual at which a pair's weight falls to a quarter, in diagonals."""


@dataclass(frozen=True, eq=False)
class JointPose:
    """The estimate and the evidence for it."""

    T_cam_obj: Float[np.ndarray, "4 4"]
    anchor: AbsoluteFit
    support: float
    """Share of the pairs' weight that agrees, over the blocks from past views."""
    anchor_support: float
    """Share of the anchor's weight that agrees."""
    residual_share: float
    """Root mean square residual of the agreeing pairs, in diagonals."""
    disagreement: float
    """Angle between this pose and the anchor's own [rad]; the axes' where symmetric."""
    foreground: float
    """Mean estimated share of points on the object."""


def solve_joint_pose(
    net: Robust6DofNet,
    features: ViewFeatures,
    past: Sequence[Keyframe],
    T_cam_pred: Float[np.ndarray, "4 4"],
    scale: float,
    symmetric: bool,
    K: Float[np.ndarray, "3 3"],
    config: JointPoseConfig,
    rng: np.random.Generator,
) -> JointPose:
    """Solve one frame.

    Args:
        net: the network, for matching.
        features: the frame, encoded (batch of one).
        past: the last frame first, then stored views; empty on the first frame.
        T_cam_pred: the motion model's prediction, one of the starts.
        scale: the track's box diagonal [m].
        symmetric: the anchor's turn about y is a gauge.
        K: intrinsics [px], for PnP.
        config: weights.
        rng: draws RANSAC's samples.

    Raises:
        InputError: the network's output is not finite.
    """
    anchor_block, anchor = _anchor_block(features, symmetric, config.anchor_weight, rng)
    if config.solver == "pnp" and past:
        return _printed_pose(net, features, past[0], T_cam_pred, anchor, symmetric, K, config)
    blocks = _past_blocks(net, features, past, config)
    starts = [T_cam_pred]
    if not symmetric:
        starts.append(anchor.T_cam_obj)
    distance = config.robust_share * scale
    starts += [_ransac_start(block, 1.5 * distance, config.hypotheses, rng) for block in blocks[:2]]
    all_blocks = [*blocks, anchor_block] if config.anchor_weight > 0 else blocks
    if not all_blocks:
        raise InputError("nothing to solve from: no past view and no anchor")
    best = min(starts, key=lambda T: _cost(all_blocks, T, distance))
    fit = fit_joint(all_blocks, best, distance)
    views = len(blocks)
    return JointPose(
        T_cam_obj=fit.T_cam_obj,
        anchor=anchor,
        support=float(fit.support[:views].mean()) if views else float(fit.support[-1]),
        anchor_support=float(fit.support[-1]),
        residual_share=float(fit.residuals[: max(views, 1)].mean()) / scale,
        disagreement=orientation_error(fit.T_cam_obj[:3, :3], anchor.T_cam_obj[:3, :3], symmetric),
        foreground=float(torch.sigmoid(features.foreground).mean()),
    )


def _anchor_block(
    features: ViewFeatures, symmetric: bool, total: float, rng: np.random.Generator
) -> tuple[PairBlock, AbsoluteFit]:
    canonical = _array(features.canonical)
    points_cam = _array(to_camera(features.points, features.T_cam_pred, features.scale))
    weight = _array(features.point_weight)
    anchor = fit_absolute(canonical, points_cam, weight, rng)
    share = total * weight / max(float(weight.sum()), 1e-12)
    return PairBlock(canonical * anchor.scale, points_cam, share, free_yaw=symmetric), anchor


def _past_blocks(
    net: Robust6DofNet,
    features: ViewFeatures,
    past: Sequence[Keyframe],
    config: JointPoseConfig,
) -> list[PairBlock]:
    """Pairs with each past view, brought into the object frame by that view's own pose."""
    if not past:
        return []
    old = ViewFeatures.cat([keyframe.features for keyframe in past])
    new = ViewFeatures.cat([features] * len(past))
    matches = net.match(old, new)
    blocks = []
    for index, keyframe in enumerate(past):
        one = slice(index, index + 1)
        pairs = select_pairs(
            old[one],
            features,
            type(matches)(matches.log_probability[one], matches.coarse_weight[one]),
            net.config.match_threshold,
            net.config.fine_matching,
        )
        weight = _array(pairs.weight[None])
        stored = max(len(past) - 1, 1)
        total = config.last_weight if index == 0 else config.memory_weight / stored
        points_obj = transform_points(
            invert_transform(keyframe.T_cam_obj), _array(pairs.previous[None])
        )
        blocks.append(
            PairBlock(points_obj, _array(pairs.current[None]), total * weight / weight.sum())
        )
    return blocks


def _ransac_start(
    block: PairBlock, distance: float, hypotheses: int, rng: np.random.Generator
) -> np.ndarray:
    return ransac_rigid(
        block.points_obj, block.points_cam, block.weight, distance, rng, hypotheses=hypotheses
    ).T_dst_src


def _printed_pose(
    net: Robust6DofNet,
    features: ViewFeatures,
    last: Keyframe,
    T_cam_pred: np.ndarray,
    anchor: AbsoluteFit,
    symmetric: bool,
    K: np.ndarray,
    config: JointPoseConfig,
) -> JointPose:
    """P_t = ΔP_t · P_(t−1), ΔP_t from PnP and RANSAC; the prediction where that finds nothing."""
    matches = net.match(last.features, features)
    threshold, fine = net.config.match_threshold, net.config.fine_matching
    pairs = select_pairs(last.features, features, matches, threshold, fine)
    previous, current = (_array(points[None]) for points in (pairs.previous, pairs.current))
    fit = None
    if len(previous) >= 4:
        fit = ransac_pnp(previous, project(current, K), K, config.inlier_px, config.hypotheses)
    T_cam_obj = T_cam_pred if fit is None else fit.T_dst_src @ last.T_cam_obj
    support = 0.0 if fit is None else float(fit.inliers.mean())
    return JointPose(
        T_cam_obj=T_cam_obj,
        anchor=anchor,
        support=support,
        anchor_support=anchor.inlier_share,
        residual_share=0.0 if fit is None else fit.residual / float(K[0, 0]),
        disagreement=orientation_error(T_cam_obj[:3, :3], anchor.T_cam_obj[:3, :3], symmetric),
        foreground=float(torch.sigmoid(features.foreground).mean()),
    )


def _cost(blocks: Sequence[PairBlock], T_cam_obj: np.ndarray, distance: float) -> float:
    """Robust cost; blocks with a free yaw are left out, as their yaw is not solved here."""
    total = 0.0
    for block in blocks:
        if block.free_yaw:
            continue
        error = transform_points(T_cam_obj, block.points_obj) - block.points_cam
        square = (error**2).sum(-1) / distance**2
        total += float(block.weight @ (square / (1.0 + square)))
    return total


def _array(values: torch.Tensor) -> np.ndarray:
    """First of the batch, as float64."""
    return values[0].double().cpu().numpy()
