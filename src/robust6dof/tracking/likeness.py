"""Is the surface that was seen one of the category? Who named the wrong one sees it here.

The network finds a pose in whatever it is shown, and agrees with itself ever after. The surface
does not: held against the category's prior at the tracked pose and size, it lies off where the
object is another thing, or stands otherwise than was thought.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial import KDTree

LARGEST_GAP: dict[str, float] = {}
"""Gap at which a thing is as likely of the category as not (docs/online-tracking.md). Of other
shapes it is not known how far their kind may lie from their prior."""
_SOFTNESS = 0.002
_FAR = 0.1
"""Points farther away than this, as a share of the diagonal, count no more: they may be of other
things."""
_MOST_POINTS = 400


@dataclass(frozen=True, eq=False)
class CategoryShape:
    """The mean shape of a category, against which surfaces are held.

    Args:
        prior: its points, canonical axes.
        category: its name.
    """

    prior: Float[np.ndarray, "N 3"]
    category: str

    def gap(self, points: Float[np.ndarray, "P 3"], extents: Float[np.ndarray, "3"]) -> float:
        """Mean distance of a seen surface from the prior, as a share of the diagonal.

        Args:
            points: of the surface, in the object frame [m].
            extents: of the object's box [m]; the prior is stretched to it.
        """
        points = points[:: max(1, len(points) // _MOST_POINTS)]
        low, high = self.prior.min(axis=0), self.prior.max(axis=0)
        shape = (self.prior - (low + high) / 2) / (high - low) * extents
        away, _ = KDTree(shape).query(points)
        return float(np.minimum(away / np.linalg.norm(extents), _FAR).mean())

    def likeness(self, gap: float) -> float:
        """Probability that a thing so far from the prior is of the category, 0 to 1; 1 where that
        is not known."""
        excess = (gap - LARGEST_GAP.get(self.category, np.inf)) / _SOFTNESS
        return float(1.0 / (1.0 + np.exp(np.clip(excess, -50.0, 50.0))))
