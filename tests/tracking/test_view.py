"""The view holds what the prediction says is the object, and maps back to where it came from."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from robust6dof.frames import RgbdFrame
from robust6dof.geometry.transforms import make_transform
from robust6dof.network.inputs import to_camera
from robust6dof.tracking.view import ViewConfig, _crop_window, make_view

K = np.array([[300.0, 0, 160], [0, 310.0, 120], [0, 0, 1]])
EXTENTS = np.array([0.12, 0.2, 0.1])
CONFIG = ViewConfig(points=256, crop_px=64)


def plane_frame(depth: float = 0.8) -> RgbdFrame:
    """A fronto-parallel plane whose colour is its pixel coordinate."""
    y, x = np.mgrid[0:240, 0:320]
    rgb = np.stack([x * 255 // 319, y * 255 // 239, np.full_like(x, 40)], -1).astype(np.uint8)
    return RgbdFrame(rgb, np.full((240, 320), depth, np.float32), K)


def prediction(x: float = 0.05, z: float = 0.82) -> np.ndarray:
    R = Rotation.from_euler("xyz", [0.4, 0.3, -0.2]).as_matrix()
    return make_transform(R, np.array([x, 0.02, z]))


def test_points_lie_in_the_grown_box_and_map_back_to_the_measured_depth() -> None:
    frame = plane_frame()
    view = make_view(frame, prediction(), EXTENTS, CONFIG, np.random.default_rng(0))
    assert view is not None
    half = EXTENTS / (2 * np.linalg.norm(EXTENTS)) + CONFIG.margin
    assert (np.abs(view.batch.points[0].numpy()) <= half + 1e-6).all()
    points_cam = to_camera(view.batch.points, view.batch.T_cam_pred, view.batch.scale)[0].numpy()
    np.testing.assert_allclose(points_cam[:, 2], 0.8, atol=1e-5)
    back = points_cam @ K.T
    np.testing.assert_allclose(back[:, :2] / back[:, 2:], view.frame_pixels, atol=1e-2)


@pytest.mark.parametrize("z", [0.82, 0.3])
def test_the_crop_shows_each_points_own_colour(z: float) -> None:
    """Also where the crop is a strong reduction of the frame (a near object)."""
    frame = plane_frame(depth=z)
    view = make_view(frame, prediction(z=z), EXTENTS, CONFIG, np.random.default_rng(0))
    assert view is not None
    pixels = view.batch.pixels[0].numpy()
    inside = ((pixels > 2) & (pixels < 61)).all(axis=1)
    # Beyond the frame the crop is black, and blends into its edge.
    inside &= ((view.frame_pixels > 8) & (view.frame_pixels < [311, 231])).all(axis=1)
    assert inside.sum() > 50
    x, y = np.rint(pixels[inside]).astype(int).T
    seen = view.batch.rgb[0].numpy()[:2, y, x].T
    truth = view.frame_pixels[inside] / [319, 239]
    # One crop pixel spans a few frame pixels, and so a little of the colour ramp.
    assert np.abs(seen - truth).max() < 0.03


def test_without_depth_near_the_prediction_there_is_no_view() -> None:
    rng = np.random.default_rng(0)
    frame = plane_frame()
    assert make_view(frame, prediction(x=3.0), EXTENTS, CONFIG, rng) is None, "out of view"
    assert make_view(frame, prediction(z=-1.0), EXTENTS, CONFIG, rng) is None, "behind"
    assert make_view(frame, prediction(z=2.0), EXTENTS, CONFIG, rng) is None, "no depth there"
    assert make_view(frame, np.full((4, 4), np.nan), EXTENTS, CONFIG, rng) is None
    empty = RgbdFrame(frame.rgb, np.zeros_like(frame.depth), K)
    assert make_view(empty, prediction(), EXTENTS, CONFIG, rng) is None


def test_few_points_are_repeated_to_n() -> None:
    depth = np.zeros((240, 320), np.float32)
    depth[118:124, 175:181] = 0.8
    frame = RgbdFrame(np.zeros((240, 320, 3), np.uint8), depth, K)
    view = make_view(frame, prediction(), EXTENTS, CONFIG, np.random.default_rng(0))
    assert view is not None
    assert view.batch.points.shape == (1, 256, 3)
    assert len(np.unique(view.frame_pixels, axis=0)) == 36


def test_what_is_cut_out_of_the_image_lies_in_it() -> None:
    """Also of a box that nearly reaches the camera beside the image: its near corners project far
    away, its far ones into the image."""
    frame, rng = plane_frame(), np.random.default_rng(0)
    windows = 0
    for _ in range(3000):
        t = rng.uniform([-0.6, -0.6, 0.1], [0.6, 0.6, 0.5])
        T_cam_pred = make_transform(Rotation.random(rng=rng).as_matrix(), t)
        window = _crop_window(frame, T_cam_pred, np.array([0.25, 0.2, 0.2]))
        if window is not None:
            x0, y0, side = window
            windows += 1
            assert x0 + side >= 0
            assert y0 + side >= 0
            assert x0 <= frame.width
            assert y0 <= frame.height
    assert windows > 100
