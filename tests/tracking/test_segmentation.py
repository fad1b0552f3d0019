"""Pieces on a table are told apart from it; hints that cannot be meant are refused."""

from __future__ import annotations

import numpy as np
import pytest

from baselines.tabletop_scene import HEIGHT, WIDTH, K, look_at_object, make_tabletop
from robust6dof.errors import InputError
from robust6dof.frames import Box, RgbdFrame
from robust6dof.tracking.segmentation import (
    DepthClusters,
    GivenMask,
    LastPose,
    Segmenter,
    propagated_mask,
    segment_box,
    segment_click,
)

SCENE = make_tabletop("mug", 0)
SHOT = SCENE.shoot(look_at_object(0.7, 0.7, 0.8), np.random.default_rng(0))
Y, X = np.nonzero(SHOT.mask)
EMPTY = RgbdFrame(np.zeros((HEIGHT, WIDTH, 3), np.uint8), np.zeros((HEIGHT, WIDTH), np.float32), K)


def overlap(a: np.ndarray, b: np.ndarray) -> float:
    return float((a & b).sum() / (a | b).sum())


def test_clusters_hold_the_object_apart_from_the_clutter() -> None:
    segmenter: Segmenter = DepthClusters()
    pieces = segmenter.segment(SHOT.frame)
    assert max(overlap(piece.mask, SHOT.mask) for piece in pieces) > 0.7
    assert len(pieces) >= 3
    for first in range(len(pieces)):
        for second in range(first):
            assert not (pieces[first].mask & pieces[second].mask).any()


def test_a_bare_image_has_no_pieces() -> None:
    assert DepthClusters().segment(EMPTY) == []


def test_a_box_is_cut_down_to_the_object_in_it() -> None:
    x, y = float(X.min() - 12), float(Y.min() - 12)
    box = Box(x, y, float(np.ptp(X) + 24), float(np.ptp(Y) + 24))
    segment = segment_box(SHOT.frame, box)
    assert overlap(segment.mask, SHOT.mask) > 0.7
    assert segment.plane is not None
    tilt = segment.plane.normal @ SHOT.T_cam_obj[:3, 1]
    assert tilt > np.cos(np.deg2rad(2.0))


def test_a_click_chooses_the_piece_under_it() -> None:
    segment = segment_click(SHOT.frame, float(np.median(X)), float(np.median(Y)))
    assert overlap(segment.mask, SHOT.mask) > 0.7


def test_the_last_pose_carries_the_mask_over() -> None:
    floor = segment_box(
        SHOT.frame, Box(float(X.min()), float(Y.min()), float(np.ptp(X)), float(np.ptp(Y)))
    ).plane
    assert floor is not None
    plane = floor.in_object_frame(SHOT.T_cam_obj)
    mask = propagated_mask(SHOT.frame, SHOT.T_cam_obj, SCENE.model.extents, plane)
    assert overlap(mask, SHOT.mask) > 0.75
    segmenter: Segmenter = LastPose(SHOT.T_cam_obj, SCENE.model.extents, plane)
    np.testing.assert_array_equal(segmenter.segment(SHOT.frame)[0].mask, mask)
    assert segmenter.segment(EMPTY) == []


def test_hints_that_cannot_be_meant_are_refused() -> None:
    frame = SHOT.frame
    nothing = np.zeros_like(SHOT.mask)
    with pytest.raises(InputError, match="mask is empty"):
        GivenMask(nothing).segment(frame)
    with pytest.raises(InputError, match="the frame is 640×480"):
        GivenMask(np.ones((10, 10), bool)).segment(frame)
    with pytest.raises(InputError, match="no valid depth inside the mask"):
        GivenMask(SHOT.mask).segment(EMPTY)
    with pytest.raises(InputError, match="outside"):
        segment_box(frame, Box(700.0, 10.0, 50.0, 50.0))
    with pytest.raises(InputError, match="no valid depth inside the box"):
        segment_box(EMPTY, Box(100.0, 100.0, 50.0, 50.0))
    with pytest.raises(InputError, match="lies outside"):
        segment_click(frame, -3.0, 20.0)
    with pytest.raises(InputError, match="nothing stands clear"):
        segment_click(EMPTY, 100.0, 100.0)
