"""Image features of the object alone."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

from robust6dof.frames import RgbdFrame
from robust6dof.geometry.transforms import invert_transform, transform_points
from robust6dof.tracking.image_features import FeatureConfig, Features, detect_features
from robust6dof.tracking.region import box_rectangle, depth_noise
from robust6dof.tracking.support_plane import Plane


def find_features(
    frame: RgbdFrame,
    T_cam_obj: Float[np.ndarray, "4 4"],
    extents: Float[np.ndarray, "3"],
    plane: Plane | None,
    margin: float,
    config: FeatureConfig,
    mask: Bool[np.ndarray, "H W"] | None = None,
) -> Features:
    """Features with depth in the box grown by `margin` [m] and above the plane, in the camera's
    frame; none where the box is out of view or there is no colour.

    Args:
        plane: in the object frame, where the object stands on one.
        mask: the object's pixels, where they are given (the first frame).
    """
    rectangle = box_rectangle(frame, T_cam_obj, extents + 2.0 * margin)
    if rectangle is None:
        return Features.none()
    features = detect_features(frame, rectangle, config)
    points_obj = transform_points(invert_transform(T_cam_obj), features.points)
    inside = np.asarray((np.abs(points_obj) < 0.5 * extents + margin).all(axis=-1))
    if plane is not None:
        inside &= plane.height(points_obj) > 0.003 + 1.5 * float(depth_noise(T_cam_obj[2, 3]))
    if mask is not None:
        inside &= mask[features.pixels[:, 1], features.pixels[:, 0]]
    return features[inside]
