"""The first pose: from a mask, a box, a click, or nothing but the category.

The category's prior is fitted to the object's points and outline, from many starts: its up axis
along the normal of the plane that the object stands on, every yaw, height and width free about
each other. The fit gives pose, metric scale and extents at once.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

from robust6dof.errors import InputError
from robust6dof.frames import Box, RgbdFrame
from robust6dof.geometry.camera import backproject
from robust6dof.geometry.transforms import check_transform
from robust6dof.shapes.priors import load_prior
from robust6dof.shapes.ycb_objects import known_extents
from robust6dof.tracking.image_plane import local_plane, plane_height
from robust6dof.tracking.prior_fit import (
    DIAGONAL_RANGE_M,
    LEAST_POINTS,
    InitialisationConfig,
    PriorFit,
)
from robust6dof.tracking.prior_residuals import InitialPose
from robust6dof.tracking.region import depth_noise
from robust6dof.tracking.segmentation import (
    DepthClusters,
    GivenMask,
    Segment,
    Segmenter,
    check_mask_size,
    connected_pieces,
    propagated_mask,
    segment_box,
    segment_click,
)

NOTHING_THERE = (
    "no depth on the object in the first frame: check the start pose, the depth's unit and that "
    "the object is in view"
)
"""Of every tracker whose start finds nothing."""


def find_initial_pose(
    frame: RgbdFrame,
    category: str,
    *,
    mask: Bool[np.ndarray, "H W"] | None = None,
    box: Box | None = None,
    click: tuple[float, float] | None = None,
    T_cam_obj: Float[np.ndarray, "4 4"] | None = None,
    extents: Float[np.ndarray, "3"] | None = None,
    prior: Float[np.ndarray, "N 3"] | None = None,
    segmenter: Segmenter | None = None,
    config: InitialisationConfig | None = None,
) -> InitialPose:
    """Pose and size of the object in the first frame, from whatever is known.

    A given pose is taken as it is; extents are estimated where they are neither given nor those of
    a YCB object. Without any hint, pieces that stand on a plane are tried and the one that fits
    the category best is taken.

    Args:
        prior: points of the category's mean shape (canonical axes, diagonal 1); by default the
            shipped one.
        segmenter: finds pieces where there is neither mask nor box; by default `DepthClusters`.

    Raises:
        InputError: an empty or misfitting mask, a box or click outside the image, no valid depth
            on the object, nothing found, extents that are not positive.
    """
    config = config or InitialisationConfig()
    if mask is not None:
        check_mask_size(mask, frame)
    extents = known_extents(category) if extents is None else _check_extents(extents)
    if T_cam_obj is not None:
        T_cam_obj = check_transform(T_cam_obj, "T_cam_obj")
        if extents is not None:
            return InitialPose(T_cam_obj, extents, 0.0, mask)
    shape = _unit(load_prior(category) if prior is None else prior)
    fitter = PriorFit(frame, category, shape, extents, config)
    if T_cam_obj is not None:
        return fitter.extents_at(T_cam_obj, _mask_at(frame, T_cam_obj, category, mask))
    segments = _segments(frame, mask, box, click, segmenter)
    fits = [fitter.fit(segment) for segment in segments[: config.candidates]]
    found = [fit for fit in fits if fit is not None]
    if not found:
        raise InputError(
            f"fewer than {LEAST_POINTS} valid depth pixels on the object; start on a frame where "
            "the depth camera sees it, or give a pose"
        )
    return min(found, key=lambda fit: fit.cost)


def _segments(
    frame: RgbdFrame,
    mask: np.ndarray | None,
    box: Box | None,
    click: tuple[float, float] | None,
    segmenter: Segmenter | None,
) -> list[Segment]:
    if mask is not None:
        return GivenMask(mask).segment(frame)
    if box is not None:
        return [segment_box(frame, box)]
    if click is not None:
        return [segment_click(frame, *click, segmenter)]
    pieces = (segmenter or DepthClusters()).segment(frame)
    if not pieces:
        raise InputError(
            "nothing that stands clear of a supporting plane was found; give a mask, a box, a "
            "click or a pose"
        )
    return pieces


def _mask_at(
    frame: RgbdFrame, T_cam_obj: np.ndarray, category: str, mask: np.ndarray | None
) -> Bool[np.ndarray, "H W"]:
    """The pixels around a given pose's centre, no wider than the category's largest objects."""
    if mask is not None:
        return GivenMask(mask).segment(frame)[0].mask
    largest = DIAGONAL_RANGE_M.get(category, (0.05, 0.4))[1]
    around = propagated_mask(frame, T_cam_obj, np.full(3, 0.8 * largest))
    if not around.any():
        raise InputError("there is no valid depth around the start pose; check it and its unit")
    plane = local_plane(frame, around, is_object=False)
    if plane is not None:
        height = plane_height(frame, plane)
        around &= height > 0.004 + 2.0 * depth_noise(frame.depth)
    labels = connected_pieces(frame, around, 0.02)
    counts = np.bincount(labels.ravel())
    counts[0] = 0
    y, x = np.nonzero(labels)
    if not len(x):
        raise InputError("nothing stands clear of its support at the start pose; give the extents")
    points, _ = backproject(frame.depth, frame.K, labels > 0)
    away = np.linalg.norm(points - T_cam_obj[:3, 3], axis=-1)
    nearest = labels[y, x][np.argsort(away)[: max(20, len(away) // 20)]]
    return labels == np.bincount(nearest).argmax()


def _unit(points: np.ndarray) -> Float[np.ndarray, "N 3"]:
    """Centred on the box, diagonal 1."""
    points = np.asarray(points, dtype=np.float64)
    low, high = points.min(axis=0), points.max(axis=0)
    return (points - (low + high) / 2) / np.linalg.norm(high - low)


def _check_extents(extents: np.ndarray) -> Float[np.ndarray, "3"]:
    extents = np.asarray(extents, dtype=np.float64)
    if extents.shape != (3,) or not np.isfinite(extents).all() or (extents <= 0).any():
        raise InputError(
            f"extents must be three positive side lengths in metres, got {extents.tolist()}"
        )
    return extents
