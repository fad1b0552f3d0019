"""Oriented points with colours: one frame's, or the model's."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import small_gicp
from jaxtyping import Float, Int, Int64

from robust6dof.geometry.transforms import transform_points

_NEIGHBOURS = 10
_KEY_BITS = 18
_KEY_HALF = 1 << (_KEY_BITS - 1)
_LUMA = np.array([0.299, 0.587, 0.114])
"""Grey from red, green, blue (ITU-R BT.601)."""


@dataclass(frozen=True, eq=False)
class Cloud:
    """Points with what the registration compares."""

    points: Float[np.ndarray, "P 3"]
    """[m]"""
    normals: Float[np.ndarray, "P 3"]
    """Unit, outwards."""
    color: Float[np.ndarray, "P 3"]
    """Red, green, blue, 0 to 255; NaN where there is no colour."""

    @property
    def intensity(self) -> Float[np.ndarray, "P"]:
        """Grey level, 0 to 255; NaN where there is no colour."""
        return self.color @ _LUMA

    def __len__(self) -> int:
        return len(self.points)

    @classmethod
    def empty(cls) -> Cloud:
        return cls(*np.zeros((3, 0, 3)))

    def __getitem__(self, index: np.ndarray | slice) -> Cloud:
        return Cloud(self.points[index], self.normals[index], self.color[index])

    def moved(self, T_dst_src: Float[np.ndarray, "4 4"]) -> Cloud:
        """In another frame."""
        points = transform_points(T_dst_src, self.points)
        return Cloud(points, self.normals @ T_dst_src[:3, :3].T, self.color)

    def joined(self, other: Cloud) -> Cloud:
        return Cloud(
            np.concatenate([self.points, other.points]),
            np.concatenate([self.normals, other.normals]),
            np.concatenate([self.color, other.color]),
        )


def voxel_cells(points: Float[np.ndarray, "P 3"], voxel: float) -> Int64[np.ndarray, "P"]:
    """One number for each voxel of side `voxel` [m], within 2^17 voxels of the origin."""
    cells = np.clip(np.floor(points / voxel), -_KEY_HALF, _KEY_HALF - 1).astype(np.int64)
    cells += _KEY_HALF
    return (cells[:, 0] << 2 * _KEY_BITS) | (cells[:, 1] << _KEY_BITS) | cells[:, 2]


def sums(group: Int[np.ndarray, "P"], values: np.ndarray, count: int) -> np.ndarray:
    """Sum of the rows of `values` [P, C] over each of `count` groups."""
    return np.stack(
        [np.bincount(group, weights=column, minlength=count) for column in values.T], axis=-1
    )


def surface_cloud(
    points: Float[np.ndarray, "P 3"],
    color: Float[np.ndarray, "P 3"],
    *,
    voxel: float,
    viewpoint: Float[np.ndarray, "3"],
    max_points: int,
    grazing_cosine: float = 0.2,
) -> Cloud:
    """Thin a view's points by voxels and estimate normals, turned towards the viewpoint.

    Points seen at a grazing angle are left out: there depth is least reliable.
    """
    _, voxel_of = np.unique(voxel_cells(points, voxel), return_inverse=True)
    counts = np.bincount(voxel_of)
    means = sums(voxel_of, np.column_stack([points, color]), len(counts)) / counts[:, None]
    if len(means) < _NEIGHBOURS:
        return Cloud.empty()
    cloud = small_gicp.PointCloud(means[:, :3])
    small_gicp.estimate_normals_covariances(cloud, small_gicp.KdTree(cloud), _NEIGHBOURS)
    normals = np.asarray(cloud.normals())[:, :3]
    towards = viewpoint - means[:, :3]
    cosine = np.sum(normals * towards, axis=-1) / np.linalg.norm(towards, axis=-1)
    normals = np.where(cosine[:, None] < 0, -normals, normals)
    keep = np.nonzero(np.abs(cosine) > grazing_cosine)[0]
    keep = keep[:: max(1, int(np.ceil(len(keep) / max_points)))]
    return Cloud(means[keep, :3], normals[keep], means[keep, 3:])
