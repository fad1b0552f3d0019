"""The object's surface, indexed for registration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import small_gicp
from jaxtyping import Float

from robust6dof.tracking.surface.cloud import Cloud

_NEIGHBOURS = 12


@dataclass(frozen=True, eq=False)
class RegistrationTarget:
    """A cloud with what the registration asks of it."""

    cloud: Cloud
    gradients: Float[np.ndarray, "P 3"]
    """Of the brightness along the surface [levels/m]; 0 where it is unknown."""
    tree: small_gicp.KdTree

    @classmethod
    def build(cls, cloud: Cloud) -> RegistrationTarget:
        return cls(cloud, intensity_gradients(cloud), small_gicp.KdTree(cloud.points))


def intensity_gradients(cloud: Cloud) -> Float[np.ndarray, "P 3"]:
    """Least-squares gradient of the brightness in each point's tangent plane [levels/m].

    The linear model of coloured ICP (Park, Zhou, Koltun 2017) over the nearest neighbours on the
    same side of the surface; zero where too few of them have colour.
    """
    intensity = cloud.intensity
    if len(cloud) < _NEIGHBOURS or np.isnan(intensity).all():
        return np.zeros((len(cloud), 3))
    tree = small_gicp.KdTree(cloud.points)
    index = np.asarray(tree.batch_knn_search(cloud.points, _NEIGHBOURS)[0]).astype(np.int64)
    arms = cloud.points[index] - cloud.points[:, None]
    steps = intensity[index] - intensity[:, None]
    same_side = np.einsum("pkc,pc->pk", cloud.normals[index], cloud.normals) > 0.5
    usable = same_side & ~np.isnan(steps)
    arms = np.where(usable[..., None], arms, 0.0)
    steps = np.where(usable, steps, 0.0)
    moments = np.einsum("pki,pkj->pij", arms, arms)
    size = np.trace(moments, axis1=1, axis2=2)[:, None, None]
    # The normal direction is pinned to zero, and a little of the rest regularises.
    moments += size * (np.einsum("pi,pj->pij", cloud.normals, cloud.normals) + 0.02 * np.eye(3))
    moments += 1e-12 * np.eye(3)
    gradients = np.linalg.solve(moments, np.einsum("pki,pk->pi", arms, steps)[..., None])[..., 0]
    enough = usable.sum(axis=1) >= 6
    return np.where(enough[:, None], gradients, 0.0)
