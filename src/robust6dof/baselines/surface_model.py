"""The object's surface as seen so far, in the object frame: what each new frame is fitted to."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import small_gicp
from jaxtyping import Float, Int64

from robust6dof.tracking.support_plane import Plane

_KEY_BITS = 18
_KEY_HALF = 1 << (_KEY_BITS - 1)


@dataclass(frozen=True, eq=False)
class SurfaceModel:
    """A voxel-thinned cloud with normals, bounded in size. Immutable: `merged` gives a new one.

    A voxel holds one point for each of the six main directions of the normal, so that the two
    sides of a thin wall stay apart.
    """

    points: Float[np.ndarray, "M 3"]
    """Object frame [m]: the weighted mean of all that was seen in each voxel."""
    normals: Float[np.ndarray, "M 3"]
    """Unit, outwards."""
    weights: Float[np.ndarray, "M"]
    """Sum of the weights of the observations that each point is the mean of."""
    voxel: float
    """Side of a voxel [m]."""
    max_points: int = 4000

    def __len__(self) -> int:
        return len(self.points)

    @classmethod
    def empty(cls, voxel: float, max_points: int = 4000) -> SurfaceModel:
        return cls(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0), voxel, max_points)

    def merged(
        self, points: Float[np.ndarray, "P 3"], normals: Float[np.ndarray, "P 3"], weight: float
    ) -> SurfaceModel:
        """Average a new view in, `weight` for each of its points."""
        if not len(points):
            return self
        points = np.concatenate([self.points, points])
        normals = np.concatenate([self.normals, normals])
        weights = np.concatenate([self.weights, np.full(len(normals) - len(self), weight)])
        _, voxel_of = np.unique(self._keys(points, normals), return_inverse=True)
        totals = np.bincount(voxel_of, weights=weights)
        mean = _sums(voxel_of, points * weights[:, None], len(totals)) / totals[:, None]
        normal = _sums(voxel_of, normals * weights[:, None], len(totals))
        normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-9)
        keep = np.sort(np.argsort(-totals, kind="stable")[: self.max_points])
        return SurfaceModel(mean[keep], normal[keep], totals[keep], self.voxel, self.max_points)

    def carved(self, refuted: np.ndarray) -> SurfaceModel:
        """Without points that a view saw through (`refuted`, [M] bool) more than it confirmed."""
        weights = np.where(refuted, 0.5 * self.weights - 0.1, self.weights)
        keep = weights > 0
        return SurfaceModel(
            self.points[keep], self.normals[keep], weights[keep], self.voxel, self.max_points
        )

    def _keys(self, points: np.ndarray, normals: np.ndarray) -> Int64[np.ndarray, "P"]:
        cells = np.floor(points / self.voxel).astype(np.int64) + _KEY_HALF
        cells = np.clip(cells, 0, 2 * _KEY_HALF - 1)
        axis = np.argmax(np.abs(normals), axis=-1)
        side = 2 * axis + (np.take_along_axis(normals, axis[:, None], axis=-1)[:, 0] > 0)
        key = (cells[:, 0] << 2 * _KEY_BITS) | (cells[:, 1] << _KEY_BITS) | cells[:, 2]
        return key * 6 + side


def _sums(voxel_of: np.ndarray, values: np.ndarray, count: int) -> np.ndarray:
    return np.stack(
        [np.bincount(voxel_of, weights=column, minlength=count) for column in values.T], axis=-1
    )


@dataclass(frozen=True, eq=False)
class RegistrationTarget:
    """The surface, and a patch of the plane that the object stands on, indexed."""

    points: Float[np.ndarray, "M 3"]
    normals: Float[np.ndarray, "M 3"]
    tree: small_gicp.KdTree

    @classmethod
    def build(
        cls, surface: SurfaceModel, plane: Plane | None, extents: np.ndarray
    ) -> RegistrationTarget:
        points, normals = surface.points, surface.normals
        if plane is not None:
            patch = _plane_patch(plane, extents)
            points = np.concatenate([points, patch])
            normals = np.concatenate([normals, np.tile(plane.normal, (len(patch), 1))])
        return cls(points, normals, small_gicp.KdTree(points))


def plane_radius(extents: np.ndarray) -> float:
    """How far from the object's centre its supporting plane is used [m]."""
    return 0.9 * float(np.linalg.norm(extents))


def _plane_patch(plane: Plane, extents: np.ndarray) -> Float[np.ndarray, "G 3"]:
    """A grid on the plane, somewhat wider than the ring of points that is matched to it."""
    radius = 1.15 * plane_radius(extents)
    first = np.cross(plane.normal, np.eye(3)[np.argmin(np.abs(plane.normal))])
    first /= np.linalg.norm(first)
    second = np.cross(plane.normal, first)
    steps = np.linspace(-radius, radius, 25)
    u, v = (grid.reshape(-1, 1) for grid in np.meshgrid(steps, steps))
    inside = np.hypot(u, v).ravel() < radius
    return (u * first + v * second - plane.offset * plane.normal)[inside]
