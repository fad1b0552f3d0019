"""Does a confidence mean what it says? Reliability over bins of equal count."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float


@dataclass(frozen=True, eq=False)
class Reliability:
    """What was claimed and what was true, bin by bin."""

    confidence: Float[np.ndarray, "B"]
    """Mean confidence of each bin."""
    share: Float[np.ndarray, "B"]
    """Share of its frames that are right."""
    count: Float[np.ndarray, "B"]

    @property
    def expected_error(self) -> float:
        """Expected calibration error: the mean gap between the two, weighted by count."""
        weight = self.count / self.count.sum()
        return float(weight @ np.abs(self.confidence - self.share))


def reliability(
    confidence: Float[np.ndarray, "N"], right: Bool[np.ndarray, "N"], bins: int = 15
) -> Reliability:
    """Over `bins` bins that hold equally many frames, from the least to the most confident.

    Frames of one confidence may fall into several bins: each counts as right by their common share.
    """
    _, tie = np.unique(confidence, return_inverse=True)
    shares = np.bincount(tie, weights=right) / np.bincount(tie)
    order = np.argsort(confidence, kind="stable")
    parts = [part for part in np.array_split(order, bins) if len(part)]
    return Reliability(
        np.array([confidence[part].mean() for part in parts]),
        np.array([shares[tie[part]].mean() for part in parts]),
        np.array([float(len(part)) for part in parts]),
    )
