"""`register_depth` against surfaces whose depth in the colour camera is known in closed form."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from robust6dof.data import register_depth
from robust6dof.geometry.transforms import make_transform

K_DEPTH = np.array([[110.0, 0.0, 63.5], [0.0, 112.0, 47.5], [0.0, 0.0, 1.0]])
DEPTH_SIZE = (128, 96)
T_COLOR_DEPTH = make_transform(
    Rotation.from_euler("xyz", [1.5, -2.0, 0.8], degrees=True).as_matrix(),
    np.array([-0.04, 0.01, 0.006]),
)


def color_camera(factor: int) -> tuple[np.ndarray, tuple[int, int]]:
    K = np.array(
        [[factor * 105.0, 0, factor * 62.0], [0, factor * 106.0, factor * 50.0], [0, 0, 1]]
    )
    return K, (factor * 128, factor * 96)


def rays(K: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    x, y = np.meshgrid(np.arange(size[0]), np.arange(size[1]))
    return np.stack([x, y, np.ones_like(x)], axis=-1) @ np.linalg.inv(K).T


def plane_depth(normal: np.ndarray, offset: float, K: np.ndarray, size: tuple[int, int]):
    """Depth [m] of the plane normal·x = offset for every pixel."""
    return offset / (rays(K, size) @ normal)


@pytest.mark.parametrize("factor", [1, 3])
def test_a_slanted_plane_is_exact_and_without_holes(factor: int) -> None:
    normal = np.array([0.5, -0.3, 1.0]) / np.linalg.norm([0.5, -0.3, 1.0])
    K, size = color_camera(factor)
    depth = plane_depth(normal, 0.9, K_DEPTH, DEPTH_SIZE)
    normal_color = T_COLOR_DEPTH[:3, :3] @ normal
    expected = plane_depth(normal_color, 0.9 + normal_color @ T_COLOR_DEPTH[:3, 3], K, size)
    registered = register_depth(depth, K_DEPTH, K, T_COLOR_DEPTH, size)
    drawn = registered > 0
    np.testing.assert_allclose(registered[drawn], expected[drawn], rtol=0.01)
    inner = np.s_[20 * factor : -20 * factor, 20 * factor : -20 * factor]
    assert drawn[inner].all()
    np.testing.assert_allclose(registered[inner], expected[inner], rtol=1e-6)


def test_the_same_camera_changes_nothing() -> None:
    rng = np.random.default_rng(3)
    depth = np.where(rng.random((96, 128)) < 0.2, 0.0, rng.uniform(0.4, 3.0, (96, 128)))
    registered = register_depth(depth, K_DEPTH, K_DEPTH, np.eye(4), DEPTH_SIZE)
    np.testing.assert_allclose(registered, depth, rtol=1e-6)


@pytest.mark.parametrize("factor", [1, 3])
def test_the_nearer_of_two_planes_hides_the_farther(factor: int) -> None:
    """A card 0.5 m away before a wall at 1.5 m, the colour camera 10 cm to the right."""
    T_color_depth = make_transform(np.eye(3), np.array([-0.1, 0.0, 0.0]))
    K, size = color_camera(factor)
    depth = np.full((96, 128), 1.5)
    depth[30:60, 40:80] = 0.5
    registered = register_depth(depth, K_DEPTH, K, T_color_depth, size)
    x_color = (rays(K, size)[..., 0] * 0.5 + 0.1) / 0.5
    pixel = np.stack([x_color, rays(K, size)[..., 1], np.ones_like(x_color)], axis=-1) @ K_DEPTH.T
    card = (
        (pixel[..., 0] >= 40)
        & (pixel[..., 0] <= 79)
        & (pixel[..., 1] >= 30)
        & (pixel[..., 1] <= 59)
    )
    assert card.sum() > 500 * factor**2
    np.testing.assert_allclose(registered[card], 0.5, rtol=1e-6)
    assert set(np.unique(registered.round(4))) == {0.0, 0.5, 1.5}, "no surface between the two"
    # From the right, the wall's strip that the card hid from the depth camera stays unknown:
    # to the right of the card by the difference of the two parallaxes.
    row = registered[48 * factor]
    last_card = np.flatnonzero(row == np.float32(0.5))[-1]
    unknown = np.flatnonzero(row[last_card + 1 :] > 0)[0]
    expected = factor * 105.0 * 0.1 * (1 / 0.5 - 1 / 1.5)
    assert abs(unknown - expected) <= 3 * factor


def test_what_lies_behind_the_colour_camera_is_not_drawn() -> None:
    T_color_depth = make_transform(np.eye(3), np.array([0.0, 0.0, -1.0]))
    depth = np.full((96, 128), 0.7)
    depth[:, 64:] = 2.0
    registered = register_depth(depth, K_DEPTH, K_DEPTH, T_color_depth, DEPTH_SIZE)
    assert set(np.unique(registered)) == {0.0, 1.0}
    assert not registered[:, :60].any()


def test_a_lone_pixel_is_kept() -> None:
    depth = np.zeros((96, 128))
    depth[40, 50] = 1.0
    depth[70, 80] = np.nan
    registered = register_depth(depth, K_DEPTH, K_DEPTH, np.eye(4), DEPTH_SIZE)
    assert registered[40, 50] == 1.0
    assert np.count_nonzero(registered) == 1


def test_the_edge_of_a_quad_with_one_missing_corner_is_drawn() -> None:
    depth = np.zeros((96, 128))
    depth[40:42, 50:52] = 1.0
    depth[40, 50] = 0.0
    K, size = color_camera(4)
    registered = register_depth(depth, K_DEPTH, K, np.eye(4), size)
    assert 4 <= np.count_nonzero(registered) <= 12
