"""The object's surface as seen so far, in the object frame: what each new frame is fitted to."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int64

from robust6dof.tracking.surface.cloud import Cloud, sums, voxel_cells

_COLOR_MEMORY = 1.0
"""Colours change with the side they are seen from (a metal lid): what was seen before counts as
much as so many views like the newest, at most."""


@dataclass(frozen=True, eq=False)
class SurfaceModel:
    """A voxel-thinned cloud, bounded in size. Immutable: `merged` gives a new one.

    A voxel holds one point for each of the six main directions of the normal, so that the two
    sides of a thin wall stay apart.
    """

    cloud: Cloud
    """Object frame: the weighted mean of all that was seen in each voxel."""
    weights: Float[np.ndarray, "P"]
    """Sum of the weights of the observations that each point is the mean of."""
    voxel: float
    """Side of a voxel [m]."""
    max_points: int = 5000

    def __len__(self) -> int:
        return len(self.weights)

    @property
    def mean_color(self) -> Float[np.ndarray, "3"]:
        """Red, green, blue, 0 to 255; NaN where no point has a colour."""
        known = ~np.isnan(self.cloud.color).any(axis=-1)
        return self.cloud.color[known].mean(axis=0) if known.any() else np.full(3, np.nan)

    @classmethod
    def empty(cls, voxel: float, max_points: int = 5000) -> SurfaceModel:
        return cls(Cloud.empty(), np.zeros(0), voxel, max_points)

    def merged(self, view: Cloud, weight: float) -> SurfaceModel:
        """Average a new view in, `weight` for each of its points; colours forget faster."""
        if not len(view):
            return self
        both = self.cloud.joined(view)
        weights = np.concatenate([self.weights, np.full(len(view), weight)])
        _, group = np.unique(self._keys(both), return_inverse=True)
        totals = np.bincount(group, weights=weights)
        points = sums(group, both.points * weights[:, None], len(totals)) / totals[:, None]
        normals = sums(group, both.normals * weights[:, None], len(totals))
        normals /= np.maximum(np.linalg.norm(normals, axis=-1, keepdims=True), 1e-9)
        recent = np.minimum(weights, _COLOR_MEMORY * weight)
        cloud = Cloud(points, normals, _known_means(group, both.color, recent, len(totals)))
        keep = np.sort(np.argsort(-totals, kind="stable")[: self.max_points])
        return SurfaceModel(cloud[keep], totals[keep], self.voxel, self.max_points)

    def carved(self, refuted: Bool[np.ndarray, "P"]) -> SurfaceModel:
        """Weaken the points that a view saw through (`refuted`); drop them when nothing is left."""
        weights = np.where(refuted, 0.5 * self.weights - 0.1, self.weights)
        keep = weights > 0
        return SurfaceModel(self.cloud[keep], weights[keep], self.voxel, self.max_points)

    def _keys(self, cloud: Cloud) -> Int64[np.ndarray, "Q"]:
        axis = np.argmax(np.abs(cloud.normals), axis=-1)
        outwards = np.take_along_axis(cloud.normals, axis[:, None], axis=-1)[:, 0] > 0
        return voxel_cells(cloud.points, self.voxel) * 6 + 2 * axis + outwards


def _known_means(
    group: np.ndarray, values: np.ndarray, weights: np.ndarray, count: int
) -> Float[np.ndarray, "V C"]:
    """Weighted mean of each group's rows that are not NaN; NaN where there are none."""
    known = ~np.any(np.isnan(values), axis=-1)
    totals = np.bincount(group, weights=weights * known, minlength=count)[:, None]
    sum_ = sums(group, weights[:, None] * np.where(known[:, None], values, 0.0), count)
    return np.where(totals > 0, sum_ / np.maximum(totals, 1e-12), np.nan)
