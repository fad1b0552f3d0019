"""Stage 3, second half: coarse-to-fine matching of keypoints between two views."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from robust6dof.network.inputs import ViewFeatures


@dataclass(frozen=True, eq=False)
class KeypointMatches:
    """How the keypoints of a previous view (rows) and the current one (columns) go together."""

    log_probability: Float[Tensor, "B K K"]
    """log P_c of the dual softmax."""
    coarse_weight: Float[Tensor, "B K"]
    """Weight of each pair of equal indices: one over the sum of both expected errors²."""

    @property
    def probability(self) -> Float[Tensor, "B K K"]:
        """P_c."""
        return self.log_probability.exp()


def score_matrix(
    previous: Float[Tensor, "B K F"], current: Float[Tensor, "B L F"], temperature: float
) -> Float[Tensor, "B K L"]:
    """S_kp = <F̃_kp(t−1), F̃_kp(t)> / τ."""
    return previous @ current.mT / temperature


def dual_softmax(scores: Float[Tensor, "B K L"]) -> Float[Tensor, "B K L"]:
    """log P_c: the softmax over the columns times that over the rows, as a logarithm."""
    return scores.log_softmax(2) + scores.log_softmax(1)


def match_views(
    previous: ViewFeatures, current: ViewFeatures, temperature: float
) -> KeypointMatches:
    """Match two views' keypoints; nothing is encoded again."""
    scores = score_matrix(previous.keypoint_features, current.keypoint_features, temperature)
    variance = (2 * previous.keypoint_log_error).exp() + (2 * current.keypoint_log_error).exp()
    return KeypointMatches(dual_softmax(scores), 1.0 / variance)


def mutual_matches(probability: Float[Tensor, "B K L"], threshold: float) -> Bool[Tensor, "B K L"]:
    """M_c: mutual nearest neighbours with probability ≥ θ_c; of equal ones the first."""
    row_best = torch.zeros_like(probability, dtype=torch.bool)
    row_best.scatter_(2, probability.argmax(2, keepdim=True), True)
    column_best = torch.zeros_like(row_best)
    column_best.scatter_(1, probability.argmax(1, keepdim=True), True)
    return row_best & column_best & (probability >= threshold)


@dataclass(frozen=True, eq=False)
class KeypointPairs:
    """Pairs of one object (no batch), ready for the solver."""

    previous: Float[Tensor, "M 3"]
    """Keypoints of the previous view, camera frame of that view [m]."""
    current: Float[Tensor, "M 3"]
    """Their partners in the current view, camera frame [m]."""
    weight: Float[Tensor, "M"]
    """Trust in each pair."""
    is_fine: bool
    """Fine matches; False: the coarse ones (equal indices), as too few fine ones survived."""


def select_pairs(
    previous: ViewFeatures,
    current: ViewFeatures,
    matches: KeypointMatches,
    threshold: float,
    fine: bool = True,
    minimum: int = 4,
) -> KeypointPairs:
    """The pairs of the first object in the batch: fine ones, or coarse where too few survive."""
    weight_prev, weight_cur = previous.keypoint_weight[0], current.keypoint_weight[0]
    if fine:
        chosen = mutual_matches(matches.probability[:1], threshold)[0]
        i, j = chosen.nonzero(as_tuple=True)
        if len(i) >= minimum:
            weight = 1.0 / (1.0 / weight_prev[i] + 1.0 / weight_cur[j])
            weight = weight * matches.probability[0, i, j]
            return KeypointPairs(
                previous.keypoints_cam[0, i], current.keypoints_cam[0, j], weight, True
            )
    weight = matches.coarse_weight[0]
    if fine:
        weight = weight * torch.diagonal(matches.probability[0]).clamp_min(1e-6)
    return KeypointPairs(previous.keypoints_cam[0], current.keypoints_cam[0], weight, False)
