"""The plane that the object stands on."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from robust6dof.frames import RgbdFrame
from robust6dof.geometry.transforms import invert_transform, transform_points
from robust6dof.tracking.region import cut_region, depth_noise


@dataclass(frozen=True, eq=False)
class Plane:
    """Points p with normal · p + offset = 0; the normal points to the free side."""

    normal: Float[np.ndarray, "3"]
    """Unit vector."""
    offset: float
    """[m]"""

    def height(self, points: np.ndarray) -> np.ndarray:
        """Signed distance [m] of points [..., 3] above the plane."""
        return np.asarray(points @ self.normal + self.offset)

    def transformed(self, T_dst_src: Float[np.ndarray, "4 4"]) -> Plane:
        """The same plane in another frame."""
        normal = T_dst_src[:3, :3] @ self.normal
        return Plane(normal, self.offset - float(normal @ T_dst_src[:3, 3]))

    def in_object_frame(self, T_cam_obj: Float[np.ndarray, "4 4"]) -> Plane:
        return self.transformed(invert_transform(T_cam_obj))


def fit_plane(
    points: Float[np.ndarray, "P 3"],
    rng: np.random.Generator,
    *,
    tolerance: float | Float[np.ndarray, "P"],
    trials: int = 100,
    viewpoint: Float[np.ndarray, "3"] | None = None,
) -> tuple[Plane, Bool[np.ndarray, "P"]] | None:
    """The plane with most points within `tolerance` [m] (one value, or one per point).

    RANSAC over triples, then two rounds of total least squares on the inliers. The normal is
    turned towards `viewpoint` (default: the origin, which is the camera).

    Returns:
        the plane and its inliers, or None with fewer than three points or only collinear ones.
    """
    if len(points) < 3:
        return None
    triples = points[rng.integers(0, len(points), (trials, 3))]
    normals = np.cross(triples[:, 1] - triples[:, 0], triples[:, 2] - triples[:, 0])
    lengths = np.linalg.norm(normals, axis=-1)
    usable = lengths > 1e-12
    if not usable.any():
        return None
    normals = normals[usable] / lengths[usable, None]
    offsets = -np.sum(normals * triples[usable, 0], axis=-1)
    counts = (np.abs(points @ normals.T + offsets) < np.reshape(tolerance, (-1, 1))).sum(axis=0)
    best = int(np.argmax(counts))
    plane = Plane(normals[best], float(offsets[best]))
    for _ in range(2):
        inliers = np.abs(plane.height(points)) < tolerance
        if inliers.sum() < 3:
            return None
        plane = least_squares_plane(points[inliers])
    plane = _facing(plane, np.zeros(3) if viewpoint is None else viewpoint)
    return plane, np.abs(plane.height(points)) < tolerance


def least_squares_plane(points: Float[np.ndarray, "P 3"]) -> Plane:
    """Total least squares: the direction in which the points spread least."""
    centre = points.mean(axis=0)
    _, vectors = np.linalg.eigh(np.cov((points - centre).T))
    return Plane(vectors[:, 0], -float(vectors[:, 0] @ centre))


def _facing(plane: Plane, viewpoint: np.ndarray) -> Plane:
    if plane.height(viewpoint) >= 0:
        return plane
    return Plane(-plane.normal, -plane.offset)


def find_support_plane(
    frame: RgbdFrame,
    T_cam_obj: Float[np.ndarray, "4 4"],
    extents: Float[np.ndarray, "3"],
    rng: np.random.Generator,
) -> Plane | None:
    """The plane, in the object frame, that the object at this pose stands on (or leans against).

    The most frequent plane around the box, if a quarter of the surroundings lie on it and it
    touches the box from outside; else None (the object is held, or its surroundings are cluttered).
    """
    scale = float(np.linalg.norm(extents))
    region = cut_region(frame, T_cam_obj, 2.2 * extents, max_points=3000)
    if region is None:
        return None
    T_obj_cam = invert_transform(T_cam_obj)
    points = transform_points(T_obj_cam, region.points_cam)
    near = np.linalg.norm(points, axis=-1) < 1.3 * scale
    outside = (np.abs(points) > 0.5 * extents).any(axis=-1)
    points = points[near & outside]
    tolerance = 0.004 + float(depth_noise(T_cam_obj[2, 3]))
    found = fit_plane(points, rng, tolerance=tolerance, viewpoint=T_obj_cam[:3, 3])
    if found is None or found[1].sum() < max(60, 0.25 * len(points)):
        return None
    plane = found[0]
    reach = 0.5 * float(np.abs(plane.normal) @ extents)
    return plane if abs(plane.offset - reach) < 0.15 * scale else None
