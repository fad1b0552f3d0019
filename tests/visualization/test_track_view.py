"""What is shown lies on the object: cloud, keypoints and both ends of each match."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from robust6dof.baselines.static import StaticTracker
from robust6dof.frames import RgbdFrame
from robust6dof.geometry.camera import project
from robust6dof.geometry.transforms import invert_transform, transform_points
from robust6dof.visualization.track_view import draw_track_view, make_track_view, visible_pixels
from visualization.tracked_mug import mug_views


def test_cloud_and_keypoints_lie_in_and_about_the_box() -> None:
    for view in mug_views():
        T_obj_cam, half = invert_transform(view.track.T_cam_obj), view.track.extents / 2
        cloud = transform_points(T_obj_cam, view.cloud_cam)
        assert len(cloud) > 300
        assert (np.abs(cloud) <= half + 0.0501).all()
        keypoints = transform_points(T_obj_cam, view.keypoints_cam)
        assert np.mean(np.all(np.abs(keypoints) <= half + 0.02, axis=1)) > 0.9


def test_the_clouds_colours_are_those_of_its_pixels() -> None:
    view = mug_views()[0]
    x, y = np.rint(project(view.cloud_cam, view.frame.K)).astype(int).T
    np.testing.assert_array_equal(view.cloud_rgb, view.frame.rgb[y, x])


def test_matches_join_the_object_in_both_images() -> None:
    views = mug_views()
    looked = [index for index, view in enumerate(views) if len(view.matches_px)]
    assert looked == [2], "the network looks at every other frame, and first has nothing to match"
    for end, view in enumerate((views[0], views[2])):
        pixels = views[2].matches_px[:, end]
        box = project(view.cloud_cam, view.frame.K)
        low, high = box.min(axis=0) - 2, box.max(axis=0) + 2
        assert np.mean(np.all((pixels >= low) & (pixels <= high), axis=1)) > 0.9


def test_a_tracker_without_network_has_no_keypoints() -> None:
    view = mug_views()[0]
    tracker = StaticTracker("mug")
    T_cam_obj, extents = view.track.T_cam_obj, view.track.extents
    track = tracker.start(view.frame, T_cam_obj=T_cam_obj, extents=extents)
    plain = make_track_view(view.frame, track)
    assert plain.keypoints_cam.shape == (0, 3)
    assert plain.matches_px.shape == (0, 2, 2)
    assert len(plain.cloud_cam) > 300


def test_the_picture_changes_at_the_keypoints() -> None:
    view = mug_views()[2]
    before = view.frame.rgb.copy()
    changed = (draw_track_view(view) != before).any(axis=-1)
    x, y = np.rint(visible_pixels(view.keypoints_cam, view.frame.K)).astype(int).T
    assert changed[y, x].all()
    np.testing.assert_array_equal(view.frame.rgb, before)


def test_a_broken_pose_and_no_depth_show_the_bare_image() -> None:
    view = mug_views()[2]
    bad = replace(view.track, T_cam_obj=np.full((4, 4), np.nan))
    empty = RgbdFrame(
        np.zeros_like(view.frame.rgb),
        np.zeros_like(view.frame.depth),
        view.frame.K,
        has_color=False,
    )
    for frame in (view.frame, empty):
        shown = make_track_view(frame, bad)
        assert len(shown.cloud_cam) == 0
        assert draw_track_view(shown).shape == frame.rgb.shape
