"""The box is drawn where the corners project; nothing behind the camera is drawn."""

import numpy as np

from robust6dof.geometry.camera import project
from robust6dof.geometry.transforms import (
    invert_transform,
    make_transform,
    rotation_about_y,
    transform_points,
)
from robust6dof.visualization.overlay import (
    axis_segments,
    colorize_depth,
    draw_box_and_axes,
    draw_label,
)

K = np.array([[300.0, 0.0, 160.0], [0.0, 300.0, 120.0], [0.0, 0.0, 1.0]])
BLACK = np.zeros((240, 320, 3), np.uint8)
EXTENTS = np.array([0.1, 0.2, 0.05])


def at(x: float, y: float, z: float) -> np.ndarray:
    T_cam_obj = np.eye(4)
    T_cam_obj[:3, 3] = x, y, z
    return T_cam_obj


def test_lines_span_exactly_the_projected_box() -> None:
    drawn = draw_box_and_axes(BLACK, K, at(0, 0, 1), EXTENTS, axes=False, thickness=1)
    rows, columns = np.nonzero(drawn.any(axis=-1))
    nearest_face = project(np.array([[0.05, 0.1, 0.975]]), K)[0]
    assert abs(columns.max() - nearest_face[0]) <= 1.5
    assert abs(rows.max() - nearest_face[1]) <= 1.5
    assert not BLACK.any(), "the input image must stay as it was"


def test_behind_the_camera_and_nan_draw_nothing() -> None:
    assert not draw_box_and_axes(BLACK, K, at(0, 0, -1), EXTENTS).any()
    assert not draw_box_and_axes(BLACK, K, np.full((4, 4), np.nan), EXTENTS).any()


def test_a_box_around_the_camera_is_cut_at_the_near_plane() -> None:
    drawn = draw_box_and_axes(BLACK, K, at(0, 0, 0), np.array([0.5, 0.5, 4.0]), axes=False)
    assert drawn.any()


def test_axes_leave_the_box_and_no_short_side_hides_its_own() -> None:
    T_cam_obj = make_transform(rotation_about_y(0.4), np.array([0.1, 0.2, 0.9]))
    starts, tips = np.swapaxes(axis_segments(T_cam_obj, np.array([0.1, 0.2, 0.001])), 0, 1)
    np.testing.assert_allclose(starts, np.tile(T_cam_obj[:3, 3], (3, 1)))
    tips_obj = transform_points(invert_transform(T_cam_obj), tips)
    np.testing.assert_allclose(tips_obj, np.diag([0.075, 0.15, 0.045]), atol=1e-12)


def test_label_darkens_only_its_own_corner() -> None:
    grey = np.full((240, 320, 3), 128, np.uint8)
    changed = (draw_label(grey, "tracking 0.93") != grey).any(axis=-1)
    assert changed.any()
    assert not changed[40:].any()


def test_invalid_depth_is_black() -> None:
    picture = colorize_depth(np.array([[0.0, np.nan, 1.0]]))
    assert not picture[0, :2].any()
    assert picture[0, 2].any()
