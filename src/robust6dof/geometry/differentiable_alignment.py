"""Weighted rigid and similarity fits that gradients flow through, also for symmetric points."""

from __future__ import annotations

from typing import cast

import roma
from jaxtyping import Float
from torch import Tensor

_TINY = 1e-12


def fit_rigid_torch(
    src: Float[Tensor, "B P 3"],
    dst: Float[Tensor, "B P 3"],
    weight: Float[Tensor, "B P"],
    gradient_eps: float = 0.02,
) -> tuple[Float[Tensor, "B 3 3"], Float[Tensor, "B 3"]]:
    """Differentiable `alignment.fit_rigid`: R_dst_src and t_dst_src.

    roma's Procrustes divides by sums of singular values σ, which vanish for symmetric and
    degenerate points; it damps 1/σ to σ/(σ² + ε²), so gradients stay below 1/(2ε). The covariance
    is divided by its own size first, so that ε means the same at every scale.
    """
    R, t, _, _ = _fit_torch(src, dst, weight, gradient_eps)
    return R, t


def fit_similarity_torch(
    src: Float[Tensor, "B P 3"],
    dst: Float[Tensor, "B P 3"],
    weight: Float[Tensor, "B P"],
    gradient_eps: float = 0.02,
) -> tuple[Float[Tensor, "B 3 3"], Float[Tensor, "B 3"], Float[Tensor, "B"]]:
    """Differentiable `alignment.fit_similarity`: R_dst_src, t_dst_src and the scale."""
    R, _, means, covariance = _fit_torch(src, dst, weight, gradient_eps)
    w = weight / weight.sum(-1, keepdim=True).clamp_min(_TINY)
    spread = (w * (src - means[0]).square().sum(-1)).sum(-1)
    scale = (R * covariance).sum((-1, -2)) / spread.clamp_min(1e-8)
    t = means[1][:, 0] - scale[:, None] * (R @ means[0].mT)[..., 0]
    return R, t, scale


def _fit_torch(
    src: Tensor, dst: Tensor, weight: Tensor, gradient_eps: float
) -> tuple[Tensor, Tensor, tuple[Tensor, Tensor], Tensor]:
    w = weight / weight.sum(-1, keepdim=True).clamp_min(_TINY)
    mean_src, mean_dst = w[:, None] @ src, w[:, None] @ dst
    covariance = (w[..., None] * (dst - mean_dst)).mT @ (src - mean_src)
    size = covariance.detach().square().sum((-1, -2), keepdim=True).sqrt().clamp_min(1e-9)
    R = cast(Tensor, roma.special_procrustes(covariance / size, gradient_eps=gradient_eps))
    t = (mean_dst - mean_src @ R.mT)[:, 0]
    return R, t, (mean_src, mean_dst), covariance
