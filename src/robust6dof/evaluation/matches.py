"""What was matched in each image, kept so that images can be drawn again without matching anew."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from robust6dof.evaluation.metrics import average_precision


@dataclass(frozen=True, eq=False)
class Matches:
    """The predictions of one class in all images, image after image, under M rules."""

    score: Float[np.ndarray, "K"]
    matched: Bool[np.ndarray, "K M"]
    """Whether each prediction found a truth under each rule."""
    predictions: Int[np.ndarray, "I"]
    """How many there are in each image; K in all."""
    truths: Int[np.ndarray, "I"]
    """Likewise."""

    @staticmethod
    def of_images(
        score: Sequence[np.ndarray], matched: Sequence[np.ndarray], truths: Sequence[int]
    ) -> Matches:
        """Put together from each image's predictions and their rules."""
        return Matches(
            np.concatenate(score),
            np.concatenate(matched),
            np.array([len(one) for one in score], int),
            np.array(truths, int),
        )

    def only(self, rules: Iterable[int]) -> Matches:
        """Some of the rules."""
        return replace(self, matched=self.matched[:, list(rules)])

    def drawn(self, images: Int[np.ndarray, "J"]) -> Matches:
        """Of these images, in this order; one drawn twice counts as two."""
        ends = np.cumsum(self.predictions)
        counts = self.predictions[images]
        begins = np.repeat(ends[images] - counts, counts)
        within = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
        rows = begins + within
        return Matches(self.score[rows], self.matched[rows], counts, self.truths[images])

    def average_precision(self) -> Float[np.ndarray, "M"]:
        """AP over all images under each rule; NaN where there is no truth."""
        truths = np.full(self.matched.shape[1], self.truths.sum())
        return average_precision(self.score, self.matched, truths)
