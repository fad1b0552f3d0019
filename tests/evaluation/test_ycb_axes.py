"""Trackers of YCB objects work upright; what goes in and comes out is in YCB-Video's axes."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from robust6dof.baselines.static import StaticTracker
from robust6dof.evaluation.ycb_axes import YcbVideoAxes, upright_mesh
from robust6dof.frames import RgbdFrame
from robust6dof.geometry.transforms import make_transform, transform_points
from robust6dof.shapes.mesh import TexturedMesh

FRAME = RgbdFrame(
    np.zeros((4, 6, 3), np.uint8),
    np.ones((4, 6), np.float32),
    np.array([[6.0, 0, 2.5], [0, 6.0, 1.5], [0, 0, 1]]),
)
T_CAM_YCBV = make_transform(
    Rotation.from_euler("xyz", [0.3, -1.1, 2.0]).as_matrix(), np.array([0.1, -0.2, 0.9])
)
SIDES = np.array([0.2, 0.1, 0.3])


class Recorded(StaticTracker):
    """Remembers the tracks that it stepped from."""

    def step(self, track, frame):
        self.given = track
        return super().step(track, frame)


def test_what_comes_back_is_in_the_axes_that_went_in() -> None:
    tracker = YcbVideoAxes(Recorded("024_bowl"))
    first = tracker.start(FRAME, T_cam_obj=T_CAM_YCBV, extents=SIDES)
    for track in (first, tracker.step(first, FRAME)):
        np.testing.assert_allclose(track.T_cam_obj, T_CAM_YCBV, atol=1e-12)
        np.testing.assert_allclose(track.extents, SIDES)


def test_the_tracker_itself_sees_the_same_box_with_y_up() -> None:
    inner = Recorded("024_bowl")
    tracker = YcbVideoAxes(inner)
    tracker.step(tracker.start(FRAME, T_cam_obj=T_CAM_YCBV, extents=SIDES), FRAME)
    np.testing.assert_allclose(inner.given.T_cam_obj[:3, 1], T_CAM_YCBV[:3, 2], atol=1e-12)
    np.testing.assert_allclose(inner.given.T_cam_obj[:3, 0], T_CAM_YCBV[:3, 0], atol=1e-12)
    np.testing.assert_allclose(inner.given.extents, SIDES[[0, 2, 1]])
    assert np.linalg.det(inner.given.T_cam_obj[:3, :3]) > 0.999


def test_its_mesh_lies_where_the_annotated_one_does() -> None:
    vertices = np.random.default_rng(0).uniform(-0.1, 0.1, (5, 3))
    texture = np.zeros((1, 1, 3), np.uint8)
    mesh = TexturedMesh(vertices, np.array([[0, 1, 2]]), np.zeros((5, 2)), texture)
    inner = Recorded("024_bowl")
    tracker = YcbVideoAxes(inner)
    tracker.step(tracker.start(FRAME, T_cam_obj=T_CAM_YCBV, extents=SIDES), FRAME)
    np.testing.assert_allclose(
        transform_points(inner.given.T_cam_obj, upright_mesh(lambda: mesh).vertices),
        transform_points(T_CAM_YCBV, vertices),
        atol=1e-12,
    )
