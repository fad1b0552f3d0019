"""Weighted rigid (Kabsch) and similarity (Umeyama) fits of paired points, in numpy."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

_TINY = 1e-12


def fit_rigid(
    src: Float[np.ndarray, "... P 3"],
    dst: Float[np.ndarray, "... P 3"],
    weight: Float[np.ndarray, "... P"] | None = None,
) -> Float[np.ndarray, "... 4 4"]:
    """T_dst_src that minimises Σ w ‖dst − T_dst_src src‖² (Kabsch 1976), never a reflection.

    Degenerate pairs (one point, a line, no weight) give some valid rotation.
    """
    T_dst_src, _ = _fit(src, dst, weight, with_scale=False)
    return T_dst_src


def fit_similarity(
    src: Float[np.ndarray, "... P 3"],
    dst: Float[np.ndarray, "... P 3"],
    weight: Float[np.ndarray, "... P"] | None = None,
) -> tuple[Float[np.ndarray, "... 4 4"], np.ndarray]:
    """T_dst_src (rigid) and scale s that minimise Σ w ‖dst − (s R src + t)‖² (Umeyama 1991).

    The scale is 1 where the source points coincide.
    """
    return _fit(src, dst, weight, with_scale=True)


def _fit(
    src: np.ndarray, dst: np.ndarray, weight: np.ndarray | None, with_scale: bool
) -> tuple[np.ndarray, np.ndarray]:
    w = np.ones(src.shape[:-1]) if weight is None else weight
    w = w / np.maximum(w.sum(-1, keepdims=True), _TINY)
    mean_src, mean_dst = (w[..., None, :] @ x for x in (src, dst))
    centred_src, centred_dst = src - mean_src, dst - mean_dst
    covariance = (w[..., None] * centred_dst).swapaxes(-1, -2) @ centred_src
    U, S, Vt = np.linalg.svd(covariance)
    flip = np.ones_like(S)
    flip[..., 2] = np.sign(np.linalg.det(U @ Vt))
    R = (U * flip[..., None, :]) @ Vt
    scale = np.ones(S.shape[:-1])
    if with_scale:
        spread = (w * (centred_src**2).sum(-1)).sum(-1)
        scale = np.where(spread > _TINY, (S * flip).sum(-1) / np.maximum(spread, _TINY), 1.0)
    T_dst_src = np.zeros((*S.shape[:-1], 4, 4))
    T_dst_src[..., :3, :3] = R
    T_dst_src[..., :3, 3] = mean_dst[..., 0, :] - scale[..., None] * np.einsum(
        "...ij,...j->...i", R, mean_src[..., 0, :]
    )
    T_dst_src[..., 3, 3] = 1.0
    return T_dst_src, scale
