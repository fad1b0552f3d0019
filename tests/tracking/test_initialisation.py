"""The first pose comes out right from every kind of hint, and impossible hints are refused."""

from __future__ import annotations

import numpy as np
import pytest

from baselines.tabletop_scene import HEIGHT, WIDTH, K, Shot, Tabletop, look_at_object, make_tabletop
from robust6dof.errors import InputError
from robust6dof.frames import SYMMETRIC_CATEGORIES, Box, RgbdFrame
from robust6dof.geometry.transforms import axis_error, rotation_error
from robust6dof.tracking.initialisation import InitialPose, find_initial_pose


def scene_and_shot(category: str, seed: int = 0, clutter: int = 4) -> tuple[Tabletop, Shot]:
    scene = make_tabletop(category, seed, clutter=clutter)
    return scene, scene.shoot(look_at_object(0.9, 0.7, 0.8), np.random.default_rng(1))


def check(found: InitialPose, shot: Shot, scene: Tabletop) -> None:
    """Within 10° and 5 cm, and a fifth of the size."""
    symmetric = scene.model.category in SYMMETRIC_CATEGORIES
    compare = axis_error if symmetric else rotation_error
    assert np.degrees(compare(found.T_cam_obj[:3, :3], shot.T_cam_obj[:3, :3])) < 10.0
    assert np.linalg.norm(found.T_cam_obj[:3, 3] - shot.T_cam_obj[:3, 3]) < 0.05
    assert np.linalg.norm(found.extents) == pytest.approx(scene.model.scale, rel=0.2)


@pytest.mark.parametrize("category", ["bottle", "bowl", "can", "laptop", "mug"])
def test_starts_from_a_mask(category: str) -> None:
    scene, shot = scene_and_shot(category)
    check(find_initial_pose(shot.frame, category, mask=shot.mask), shot, scene)


def test_starts_from_a_box_a_click_or_nothing() -> None:
    scene, shot = scene_and_shot("bowl", clutter=0)
    y, x = np.nonzero(shot.mask)
    box = Box(float(x.min() - 8), float(y.min() - 8), float(np.ptp(x) + 16), float(np.ptp(y) + 16))
    check(find_initial_pose(shot.frame, "bowl", box=box), shot, scene)
    check(find_initial_pose(shot.frame, "bowl", click=(x.mean(), y.mean())), shot, scene)
    check(find_initial_pose(shot.frame, "bowl"), shot, scene)


def test_a_given_pose_is_kept_and_its_extents_are_estimated() -> None:
    scene, shot = scene_and_shot("mug")
    found = find_initial_pose(shot.frame, "mug", T_cam_obj=shot.T_cam_obj)
    np.testing.assert_allclose(found.T_cam_obj, shot.T_cam_obj, atol=1e-12)
    np.testing.assert_allclose(found.extents, scene.model.extents, rtol=0.3)
    both = find_initial_pose(
        shot.frame, "mug", T_cam_obj=shot.T_cam_obj, extents=scene.model.extents
    )
    np.testing.assert_array_equal(both.extents, scene.model.extents)


def test_given_extents_are_kept_while_the_pose_is_found() -> None:
    scene, shot = scene_and_shot("can")
    found = find_initial_pose(shot.frame, "can", mask=shot.mask, extents=scene.model.extents)
    np.testing.assert_array_equal(found.extents, scene.model.extents)
    check(found, shot, scene)


def test_impossible_hints_are_refused() -> None:
    _, shot = scene_and_shot("can")
    frame = shot.frame
    empty = RgbdFrame(frame.rgb, np.zeros((HEIGHT, WIDTH), np.float32), K)
    with pytest.raises(InputError, match="mask is empty"):
        find_initial_pose(frame, "can", mask=np.zeros_like(shot.mask))
    with pytest.raises(InputError, match="nothing that stands clear"):
        find_initial_pose(empty, "can")
    with pytest.raises(InputError, match="no valid depth around the start pose"):
        find_initial_pose(empty, "can", T_cam_obj=shot.T_cam_obj)
    with pytest.raises(InputError, match="positive side lengths"):
        find_initial_pose(
            frame, "can", T_cam_obj=shot.T_cam_obj, extents=np.array([0.1, -0.1, 0.1])
        )
    with pytest.raises(InputError, match="no prior"):
        find_initial_pose(frame, "teapot", mask=shot.mask)
    few = np.zeros_like(shot.mask)
    y, x = np.nonzero(shot.mask & (frame.depth > 0))
    few[y[:5], x[:5]] = True
    with pytest.raises(InputError, match="fewer than 30"):
        find_initial_pose(frame, "can", mask=few)


def test_a_mask_of_another_size_is_refused_beside_a_pose_as_well() -> None:
    black = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    frame = RgbdFrame(black, np.ones((HEIGHT, WIDTH), np.float32), K)
    mask = np.ones((24, 32), bool)
    with pytest.raises(InputError, match=f"the mask is 32×24 but the frame is {WIDTH}×{HEIGHT}"):
        find_initial_pose(frame, "mug", mask=mask, T_cam_obj=np.eye(4), extents=np.ones(3))
