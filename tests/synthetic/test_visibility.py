"""A handle counts only while it is seen."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from robust6dof.geometry.transforms import invert_transform, make_transform
from robust6dof.rendering.rasteriser import render, render_depth
from robust6dof.rendering.scene import Camera, Light, MeshInstance, Scene
from robust6dof.shapes.procedural import make_object
from robust6dof.synthetic.visibility import handle_visible, visible_surface, whole_silhouette

K = np.array([[200.0, 0, 63.5], [0, 200.0, 63.5], [0, 0, 1]])


def surface_from(azimuth_deg: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Points of a mug seen level from an azimuth about its y axis (0: from its handle's side)."""
    mug = make_object("mug", seed)
    turn = Rotation.from_euler("y", azimuth_deg - 90, degrees=True).as_matrix()
    T_cam_obj = make_transform(np.diag([1.0, -1, -1]) @ turn, np.array([0, 0, 0.4]))
    scene = Scene([MeshInstance(mug.mesh, np.eye(4), 1)], [Light(np.array([0, -1.0, 0]))])
    rendering = render(scene, Camera(K, 128, 128, invert_transform(T_cam_obj)))
    return visible_surface(rendering, 1, K, T_cam_obj), mug.extents


def test_handle_is_seen_from_its_side_and_hidden_from_behind() -> None:
    for seed in range(6):
        assert handle_visible(*surface_from(0, seed))
        assert handle_visible(*surface_from(90, seed))
        assert not handle_visible(*surface_from(180, seed))


def test_visible_surface_lies_on_the_box() -> None:
    points, extents = surface_from(60, 0)
    assert len(points) > 300
    assert (np.abs(points) <= extents / 2 + 1e-4).all()


def test_nothing_in_view_shows_no_handle() -> None:
    assert not handle_visible(np.zeros((0, 3)), np.array([0.12, 0.1, 0.08]))


@pytest.mark.parametrize(
    "offset", [(0, 0, 0.5), (0.3, -0.2, 0.5), (-0.36, 0, 0.4), (0.05, 0, 0.08)]
)
def test_the_whole_silhouette_is_that_of_a_large_image(offset: tuple[float, ...]) -> None:
    mug = make_object("mug", 3)
    T_cam_obj = make_transform(Rotation.from_rotvec([2.5, 0.4, 0.3]).as_matrix(), np.array(offset))
    camera = Camera(K, 128, 128, np.eye(4))
    K_wide = K + np.array([[0, 0, 128.0], [0, 0, 128.0], [0, 0, 0]])
    scene = Scene([MeshInstance(mug.mesh, T_cam_obj, 1)])
    _, ids = render_depth(scene, Camera(K_wide, 384, 384, np.eye(4)))
    assert whole_silhouette(mug.mesh, T_cam_obj, camera) == ids.sum() > 0


def test_an_object_behind_the_camera_has_no_silhouette() -> None:
    T_cam_obj = make_transform(np.eye(3), np.array([0, 0, -0.5]))
    camera = Camera(K, 128, 128, np.eye(4))
    assert whole_silhouette(make_object("can", 0).mesh, T_cam_obj, camera) == 0
