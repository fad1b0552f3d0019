"""When a registered surface is believed: its depth must be there, and its colours."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from baselines.tabletop_scene import look_at_object, make_tabletop
from robust6dof.frames import RgbdFrame
from robust6dof.geometry.transforms import make_transform
from robust6dof.tracking.surface.fit_quality import FitQuality, assess
from robust6dof.tracking.surface.icp import IcpTracker
from robust6dof.tracking.surface.icp_config import IcpConfig
from robust6dof.tracking.surface.icp_memory import IcpMemory, assess_surface

SCENE = make_tabletop("mug", 0)
SHOT = SCENE.shoot(look_at_object(0.7, 0.7, 0.7), np.random.default_rng(0))


@pytest.fixture(scope="module")
def memory() -> IcpMemory:
    tracker = IcpTracker("mug")
    return tracker.start(SHOT.frame, T_cam_obj=SHOT.T_cam_obj, extents=SCENE.model.extents).memory


def quality(frame: RgbdFrame, memory: IcpMemory) -> FitQuality:
    return assess_surface(frame, SHOT.T_cam_obj, memory.surface)[0]


def test_the_view_that_it_was_learned_from_fits_in_depth_and_colour(memory: IcpMemory) -> None:
    own = quality(SHOT.frame, memory)
    assert own.color_gap < 0.03
    assert own.confidence > 0.9


def test_the_same_shape_in_other_colours_is_doubted(memory: IcpMemory) -> None:
    bleached = replace(SHOT.frame, rgb=255 - SHOT.frame.rgb)
    assert quality(bleached, memory).color_gap > 0.15
    assert quality(bleached, memory).confidence < 0.2


def test_a_change_of_exposure_is_not_another_object(memory: IcpMemory) -> None:
    darker = replace(SHOT.frame, rgb=(0.9 * SHOT.frame.rgb).astype(np.uint8))
    assert quality(darker, memory).confidence > 0.7


def test_a_surface_without_colours_is_judged_by_depth_alone(memory: IcpMemory) -> None:
    cloud = memory.surface.cloud
    plain = replace(cloud, color=np.full_like(cloud.color, np.nan))
    spacing = memory.surface.voxel
    found, _ = assess(SHOT.frame, SHOT.T_cam_obj, plain, spacing=spacing)
    assert found.color_gap == 0.0
    assert found.confidence > 0.9


def test_a_surface_that_the_image_sees_through_is_refuted(memory: IcpMemory) -> None:
    T_nearer = make_transform(np.eye(3), np.array([0.0, 0.0, -0.1])) @ SHOT.T_cam_obj
    found, refuted = assess_surface(SHOT.frame, T_nearer, memory.surface, every=1)
    assert found.contradicted > 0.9
    assert refuted.any()
    assert found.confidence < 0.1


def test_nothing_is_learned_until_probation_is_served(memory: IcpMemory) -> None:
    config = IcpConfig(probation_frames=3)
    memory = memory.on_probation(True, 0.0, config)
    served = []
    for confidence in (0.9, 0.5, 0.9, 0.9, 0.9):
        memory = memory.on_probation(False, confidence, config)
        served.append(memory.probation == 0)
    assert served == [False, False, False, True, True]
