"""YCB-Video re-rendered: things stand on the table found, poses and masks fit, runs repeat."""

import json

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from robust6dof.data.image_files import read_color
from robust6dof.data.truth_file import open_with_truth
from robust6dof.errors import DataError, InputError
from robust6dof.geometry.camera import project
from robust6dof.synthetic.support_plane import find_support
from robust6dof.synthetic.ycb_source import YcbSource, plan_ycb_video
from robust6dof.synthetic.ycb_video import RerenderedVideo, render_ycb_video, write_models
from shared_data import shared_data

SIZES = {"025_mug": (0.08, 0.1, 0.08), "004_sugar_box": (0.05, 0.16, 0.1)}
R_DOWN = Rotation.from_euler("x", 200, degrees=True)
"""The things' y axis points up and away from the camera's view from above."""


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    """Two boxes side by side, seen by a camera that moves 5 mm a frame."""
    root = tmp_path_factory.mktemp("ycb")
    poses, arrays, frames = root / "poses", {}, {}
    (poses / "models_points").mkdir(parents=True)
    (poses / "image_sets").mkdir()
    (poses / "image_sets" / "keyframe.txt").write_text("0048/000001\n0048/000003\n0049/000001\n")
    for i, (name, size) in enumerate(SIZES.items()):
        place = np.array([0.16 * i - 0.08, 0.0, 0.8]) + R_DOWN.apply([0, size[1] / 2, 0])
        rows = [[*R_DOWN.as_quat()[[3, 0, 1, 2]], *(place + [0.005 * f, 0, 0])] for f in range(4)]
        arrays[f"0048/{name}"] = np.array(rows, np.float32)
        box = trimesh.creation.box(size)
        np.savetxt(poses / "models_points" / f"{name}.xyz", box.sample(200, seed=0))
        shift = np.array([0.01, 0.02, 0.03 * i])
        box.apply_translation(shift)
        (root / "meshes" / name).mkdir(parents=True)
        box.export(root / "meshes" / name / "textured.obj")
        frames[name] = {
            "R_ycbv_to_google16k": np.eye(3).tolist(),
            "t_ycbv_to_google16k_m": shift.tolist(),
        }
    np.savez(poses / "ycbv_gt_poses_by_video.npz", **arrays)
    (poses / "ycbv_to_google16k_frame.json").write_text(json.dumps(frames))
    return YcbSource(poses, root / "meshes")


def test_the_support_is_the_plane_that_most_things_touch_from_above():
    rng = np.random.default_rng(0)
    R = Rotation.random(rng=rng).as_matrix()
    heights = (0.1, 0.2, 0.05)
    things = []
    for i, height in enumerate(heights):
        corners = np.array([[x, y, z] for x in (0, 0.05) for y in (0, height) for z in (0, 0.05)])
        things.append((corners + [0.1 * i, 0, 0.03 * i]) @ R.T)
    T = find_support(things, R @ np.array([0.1, 0.9, 0.4]))
    np.testing.assert_allclose(T[:3, 1], R[:, 1], atol=1e-3)
    assert (R.T @ T[:3, 3])[1] == pytest.approx(0.0, abs=1e-3)
    assert np.linalg.det(T[:3, :3]) == pytest.approx(1.0)


def test_a_rendered_video_reads_as_a_recording_whose_truth_fits(source, tmp_path):
    (plan,) = plan_ycb_video(source, seed=0, frames=3)
    render_ycb_video(plan, source, tmp_path)
    write_models([plan], source, tmp_path)
    (sequence,) = open_with_truth(tmp_path).sequences
    assert (sequence.name, sequence.frame_names) == ("0048", ("000001", "000002", "000003"))
    for truth in sequence.truth(2):
        assert truth.visible_fraction is not None
        assert truth.extents is not None
        assert truth.mask is not None
        assert truth.visible_fraction > 0.7
        np.testing.assert_allclose(truth.extents, SIZES[truth.name], atol=0.01)
        y, x = np.nonzero(truth.mask)
        centre = project(truth.T_cam_box[None, :3, 3], sequence.frame(2).K)[0]
        np.testing.assert_allclose([x.mean(), y.mean()], centre, atol=25)
        depth = sequence.frame(2).depth[truth.mask]
        assert abs(np.median(depth[depth > 0]) - truth.T_cam_box[2, 3]) < 0.1
    assert (tmp_path / "image_sets" / "keyframe.txt").read_text().split() == [
        "0048/000001",
        "0048/000003",
    ]
    mesh = trimesh.load_mesh(tmp_path / "models" / "025_mug.ply")
    np.testing.assert_allclose(mesh.bounds.mean(axis=0), 0, atol=1e-6)


def test_the_same_seed_makes_the_same_bytes_and_a_whole_video_is_kept(source, tmp_path):
    (plan,) = plan_ycb_video(source, seed=3, every=2, frames=1)
    first = render_ycb_video(plan, source, tmp_path / "a") / "rgb" / "000001.png"
    second = render_ycb_video(plan, source, tmp_path / "b") / "rgb" / "000001.png"
    np.testing.assert_array_equal(read_color(first), read_color(second))
    written = first.stat().st_mtime_ns
    render_ycb_video(plan, source, tmp_path / "a")
    assert first.stat().st_mtime_ns == written


def test_skipped_frames_have_no_keyframes_and_bad_requests_are_refused(source, tmp_path):
    plans = plan_ycb_video(source, seed=0, every=2)
    assert plans[0].frames == (1, 3)
    write_models(plans, source, tmp_path)
    assert not (tmp_path / "image_sets" / "keyframe.txt").exists()
    with pytest.raises(InputError, match="takes 0048"):
        plan_ycb_video(source, 0, videos=("0001",))
    with pytest.raises(DataError, match="the file is missing"):
        plan_ycb_video(YcbSource(tmp_path, tmp_path), 0)


def test_the_camera_velocity_is_that_of_the_poses(source):
    (plan,) = plan_ycb_video(source, seed=0)
    twist = RerenderedVideo(plan, source)._twist(2)
    np.testing.assert_allclose(twist, [-0.005 * 30, 0, 0, 0, 0, 0], atol=1e-4)


def test_real_scans_stand_on_the_table_of_the_real_video():
    source = YcbSource(shared_data("ycb_video_poses"), shared_data("ycb_meshes"))
    (plan,) = plan_ycb_video(source, seed=0, videos=("0050",), frames=1)
    video = RerenderedVideo(plan, source)
    T_world_table = video._table.T_world_mesh
    heights = []
    for name in plan.objects:
        T_world_obj = np.linalg.inv(video._poses[plan.objects[0]][0]) @ video._poses[name][0]
        T_table_obj = np.linalg.inv(T_world_table) @ T_world_obj
        points = video._meshes[name].vertices @ T_table_obj[:3, :3].T + T_table_obj[:3, 3]
        heights.append(points[:, 1].min())
    assert np.max(np.abs(heights)) < 0.012
