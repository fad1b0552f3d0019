"""What every source of training pairs does alike, from the image on: crop, truth, pair."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Bool, Float
from torch.utils.data import Dataset

from robust6dof.errors import InputError
from robust6dof.evaluation.records import HANDLED_CATEGORIES
from robust6dof.frames import SYMMETRIC_CATEGORIES, RgbdFrame
from robust6dof.shapes.priors import load_prior
from robust6dof.tracking.view import View, ViewConfig, make_view
from robust6dof.training.pair_batch import PairBatch, batch_of_one
from robust6dof.training.prediction_errors import ErrorSource
from robust6dof.training.targets import PairTruth

LEAST_ON_OBJECT = 0.1
"""Share of a view's points below which it does not show the object."""
_MOST_DRAWS = 500


@dataclass(frozen=True, eq=False)
class SeenView:
    """One view and what is true of it."""

    view: View
    T_cam_obj: Float[np.ndarray, "4 4"]
    on_object: Bool[np.ndarray, "N"]
    handle_visible: bool = True


class DrawnPairs(Dataset[PairBatch], ABC):
    """Pair i is drawn from the seed (seed, i) alone: any worker, any order, the same pair.

    Args:
        view: what is cut out of a frame.
        prior_points: N_r.
        seed: of all pairs.
        count: length of this data set.
        categories: taken in turn.
        errors: of the predictions that the views are looked at with.
    """

    def __init__(
        self,
        view: ViewConfig,
        prior_points: int,
        seed: int,
        count: int,
        categories: Sequence[str],
        errors: ErrorSource,
    ) -> None:
        self.view = view
        self.prior_points = prior_points
        self.seed = seed
        self.count = count
        self.categories = tuple(categories)
        self.errors = errors
        self.priors = {name: load_prior(name) for name in self.categories}

    def __len__(self) -> int:
        return self.count

    def __getitem__(self, index: int) -> PairBatch:
        """Pair `index` as a batch of one; draws again, from the same stream, if nothing is seen.

        Raises:
            InputError: nothing is seen, however often it is drawn.
        """
        rng = np.random.default_rng([self.seed, index])
        category = self.categories[index % len(self.categories)]
        for _ in range(_MOST_DRAWS):
            pair = self._draw(rng, category)
            if pair is not None:
                return pair
        raise InputError(
            f"{_MOST_DRAWS} draws gave no pair of views of '{category}' in which at least "
            f"{LEAST_ON_OBJECT:.0%} of the points lie on it: are poses, sizes and depth right? "
            "robust6dof doctor draws them"
        )

    @abstractmethod
    def _draw(self, rng: np.random.Generator, category: str) -> PairBatch | None:
        """One pair of that category; None where too little is seen."""

    def _see(
        self,
        rng: np.random.Generator,
        frame: RgbdFrame,
        mask: Bool[np.ndarray, "H W"],
        T_cam_obj: Float[np.ndarray, "4 4"],
        T_cam_pred: Float[np.ndarray, "4 4"],
        extents_pred: Float[np.ndarray, "3"],
    ) -> SeenView | None:
        """One view from a prediction; None where too little of the object is seen."""
        view = make_view(frame, T_cam_pred, extents_pred, self.view, rng)
        if view is None:
            return None
        x, y = view.frame_pixels.astype(int).T
        on_object = mask[y, x]
        if on_object.mean() < LEAST_ON_OBJECT:
            return None
        return SeenView(view, T_cam_obj, on_object)

    def _assemble(
        self,
        rng: np.random.Generator,
        category: str,
        scale: float,
        previous: SeenView,
        current: SeenView,
    ) -> PairBatch:
        """The two views, the category's prior, and the truth."""
        prior = self.priors[category]
        chosen = rng.choice(len(prior), self.prior_points, replace=len(prior) < self.prior_points)
        handle_seen = previous.handle_visible or current.handle_visible
        hidden_handle = category in HANDLED_CATEGORIES and not handle_seen
        symmetric = category in SYMMETRIC_CATEGORIES or hidden_handle
        truth = PairTruth(
            T_cam_obj_prev=batch_of_one(previous.T_cam_obj),
            T_cam_obj_cur=batch_of_one(current.T_cam_obj),
            scale=batch_of_one(np.array(scale)),
            symmetric=torch.tensor([symmetric]),
            on_object_prev=torch.from_numpy(previous.on_object)[None],
            on_object_cur=torch.from_numpy(current.on_object)[None],
        )
        return PairBatch(
            previous.view.batch, current.view.batch, batch_of_one(prior[chosen]), truth
        )
