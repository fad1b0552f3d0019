"""The table under things whose poses alone are known."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from scipy.spatial import ConvexHull

from robust6dof.geometry.transforms import make_transform

_TOUCH_M = 0.006
"""A thing this near to a plane stands on it."""


def find_support(
    things: Sequence[Float[np.ndarray, "_ 3"]], camera: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "4 4"]:
    """The plane that most of the things touch from above, seen from the camera: a facet of their
    convex hull. Returns the pose of a frame on it below the things, y up."""
    hull = ConvexHull(np.concatenate(things))
    planes = np.unique(np.round(hull.equations, 4), axis=0)  # outward normal, offset
    below = planes[planes[:, :3] @ camera + planes[:, 3] < 0]
    touching = [
        sum(float((thing @ p[:3] + p[3]).max()) > -_TOUCH_M for thing in things) for p in below
    ]
    area = [_footing(np.concatenate(things), plane) for plane in below]
    best = below[max(range(len(below)), key=lambda i: (touching[i], area[i]))]
    up = -best[:3] / np.linalg.norm(best[:3])
    middle = np.mean([thing.mean(axis=0) for thing in things], axis=0)
    place = middle - up * (up @ middle - best[3])
    x = np.cross(up, [0.0, 0.0, 1.0] if abs(up[2]) < 0.9 else [1.0, 0.0, 0.0])
    x /= np.linalg.norm(x)
    return make_transform(np.stack([x, up, np.cross(x, up)], axis=1), place)


def _footing(points: np.ndarray, plane: np.ndarray) -> int:
    """How many points lie on the plane."""
    return int((points @ plane[:3] + plane[3] > -_TOUCH_M).sum())
