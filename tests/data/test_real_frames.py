"""The single real frames on table tops, through the same doors as one's own recording."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from data.tabletop import (
    GRASPNET_OBJECTS,
    graspnet_frame,
    m3t_triangle,
    sarnet_mug,
    write_m3t_recording,
)
from robust6dof.data import read_video, write_sequence
from robust6dof.geometry.camera import backproject, project
from robust6dof.geometry.transforms import transform_points


def test_depth_of_a_real_second_camera_lands_where_its_points_project(tmp_path: Path) -> None:
    """Against every raw point by itself: none is nearer than what is drawn, most are drawn."""
    path = write_m3t_recording(tmp_path / "m3t")
    registered = read_video(path)[0]
    raw = read_video(path, depth_only=True)[0]
    assert registered.depth.shape == (540, 960)
    assert raw.depth.shape == (480, 848)
    points, _ = backproject(raw.depth, raw.K)
    points = transform_points(np.loadtxt(path / "T_color_depth.txt"), points)
    x, y = np.rint(project(points, registered.K)).astype(int).T
    inside = (x >= 0) & (x < 960) & (y >= 0) & (y < 540)
    drawn, z = registered.depth[y[inside], x[inside]], points[inside, 2]
    assert np.mean(drawn > 0) > 0.999
    assert np.mean(drawn < 1.02 * z) > 0.99
    assert np.mean(np.abs(drawn - z) < 0.02 * z) > 0.9


def test_the_real_triangle_lies_in_the_colour_image(tmp_path: Path) -> None:
    frame = read_video(write_m3t_recording(tmp_path / "m3t"))[0]
    T_color_obj, vertices = m3t_triangle()
    pixels = project(transform_points(T_color_obj, vertices), frame.K)
    np.testing.assert_allclose(pixels.mean(axis=0), [385, 270], atol=25)


@pytest.mark.parametrize("name", GRASPNET_OBJECTS)
def test_graspnet_frames_carry_their_object(name: str, tmp_path: Path) -> None:
    """The object's points are part of the back-projected depth, also after writing millimetres."""
    frame, points = graspnet_frame(name)
    write_sequence(tmp_path, [frame])
    stored = read_video(tmp_path)[0]
    x, y = np.rint(project(points, stored.K)).astype(int).T
    error = np.abs(stored.depth[y, x] - points[:, 2])
    assert np.median(error) < 0.005


def test_sarnet_mug_is_in_reach(tmp_path: Path) -> None:
    frame, mask = sarnet_mug()
    write_sequence(tmp_path, [frame], [mask])
    video = read_video(tmp_path)
    stored_mask = video.mask(0)
    assert stored_mask is not None
    points, _ = backproject(video[0].depth, frame.K, stored_mask)
    assert 0.5 < np.median(points[:, 2]) < 0.8
    spread = np.ptp(np.quantile(points, [0.05, 0.95], axis=0), axis=0)
    assert (spread[:2] < 0.16).all()
