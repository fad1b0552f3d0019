"""Pairs kept and seen again, each time a little different."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch
from jaxtyping import Float
from scipy.spatial.transform import Rotation
from torch import Tensor
from torch.utils.data import Dataset

from robust6dof.network.inputs import ViewBatch
from robust6dof.training.drawn_pairs import DrawnPairs
from robust6dof.training.pair_batch import PairBatch, batch_of_one


class RepeatedPairs(Dataset[PairBatch]):
    """An epoch of pairs seen again and again, each time with other points, colours and predictions.

    Rendering costs as much as a step of a small network; the pairs of an epoch are kept. What
    number `index` gives depends on it and the seed alone.

    Args:
        pairs: the pairs, with more points than are to be given.
        epoch: how many of them.
        points: N, drawn anew each time.
        prior_points: N_r, likewise.
        count: length of this data set.
    """

    def __init__(
        self, pairs: DrawnPairs, epoch: int, points: int, prior_points: int, count: int
    ) -> None:
        self.pairs = pairs
        self.epoch = epoch
        self.points = points
        self.prior_points = prior_points
        self.count = count
        self._kept: dict[int, PairBatch] = {}

    def __len__(self) -> int:
        return self.count

    def __getitem__(self, index: int) -> PairBatch:
        """Pair `index` modulo the epoch, drawn anew."""
        number = index % self.epoch
        if number not in self._kept:
            self._kept[number] = self.pairs[number]
        pair = self._kept[number]
        rng = np.random.default_rng([self.pairs.seed, index, 1])
        rows_prev, rows_cur = (
            torch.from_numpy(rng.permutation(pair.previous.points.shape[1])[: self.points])
            for _ in range(2)
        )
        rows_prior = torch.from_numpy(rng.permutation(pair.prior.shape[1])[: self.prior_points])
        truth = replace(
            pair.truth,
            on_object_prev=pair.truth.on_object_prev[:, rows_prev],
            on_object_cur=pair.truth.on_object_cur[:, rows_cur],
        )
        return PairBatch(
            _redrawn(pair.previous, rows_prev, rng),
            _redrawn(pair.current, rows_cur, rng),
            pair.prior[:, rows_prior],
            truth,
        )


def _redrawn(view: ViewBatch, rows: Tensor, rng: np.random.Generator) -> ViewBatch:
    """The view with these points alone, another white balance and a slightly other prediction."""
    balance = batch_of_one(rng.uniform(0.8, 1.2, (3, 1, 1)))
    points, T_cam_pred, scale = _predicted_anew(
        view.points[:, rows], view.T_cam_pred, view.scale, rng
    )
    return replace(
        view,
        points=points,
        pixels=view.pixels[:, rows],
        rgb=(view.rgb * balance).clamp(0, 1),
        T_cam_pred=T_cam_pred,
        scale=scale,
    )


def _predicted_anew(
    points: Float[Tensor, "1 N 3"],
    T_cam_pred: Float[Tensor, "1 4 4"],
    scale: Float[Tensor, "1"],
    rng: np.random.Generator,
    turn: float = np.deg2rad(4.0),
    shift: float = 0.03,
    growth: float = 0.04,
) -> tuple[Tensor, Tensor, Tensor]:
    """The same points in the camera from a prediction turned, shifted and scaled a little more.

    p' = R (p − d) / k; the predicted frame turns by Rᵀ, shifts by d and grows by k.
    """
    R = batch_of_one(Rotation.from_rotvec(rng.normal(0, turn, 3)).as_matrix())
    d, k = batch_of_one(rng.normal(0, shift, 3)), float(np.exp(rng.normal(0, growth)))
    T = T_cam_pred.clone()
    T[:, :3, :3] = T_cam_pred[:, :3, :3] @ R.mT
    T[:, :3, 3] += scale[:, None] * (T_cam_pred[:, :3, :3] @ d[..., None])[..., 0]
    return (points - d[:, None]) @ R.mT / k, T, scale * k
