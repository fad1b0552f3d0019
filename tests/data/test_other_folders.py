"""Folders without images: what doctor says of meshes, model points and stored poses."""

import zipfile

import cv2
import numpy as np
import pytest
import trimesh

from robust6dof.data.inspection import inspect_folder
from robust6dof.data.other_folders import loose_images, other_contents
from shared_data import shared_data


def test_meshes_are_counted_and_measured(tmp_path):
    for name, side in (("mug", 0.1), ("can", 0.2)):
        (tmp_path / name).mkdir()
        trimesh.creation.box((side, 0.05, 0.05)).export(tmp_path / name / "a.ply")
    ((sound, text),) = other_contents(tmp_path)
    assert sound
    assert "2 meshes, largest sides 0.10 to 0.20 m" in text
    trimesh.creation.box((100.0, 50.0, 50.0)).export(tmp_path / "mug" / "b.ply")
    assert [ok for ok, _ in other_contents(tmp_path)] == [False, False]
    inspection = inspect_folder(tmp_path)
    assert inspection.problems == 2
    assert "unit is probably not the metre" in inspection.findings[2].text


def test_trajectories_points_keyframes_and_packs_are_told_apart(tmp_path):
    rows = np.tile([1.0, 0, 0, 0, 0, 0, 0.8], (5, 1))
    np.savez(tmp_path / "ycbv_gt_poses_by_video.npz", **{"0048/025_mug": rows})
    (tmp_path / "models_points").mkdir()
    points = np.random.default_rng(0).random((20, 3)) * 0.1
    np.savetxt(tmp_path / "models_points" / "025_mug.xyz", points)
    (tmp_path / "image_sets").mkdir()
    (tmp_path / "image_sets" / "keyframe.txt").write_text("0048/000001\n0048/000036\n")
    with zipfile.ZipFile(tmp_path / "poses.zip", "w") as pack:
        for method in ("ground_truth", "mine"):
            pack.writestr(f"poses/{method}/0048_025_mug.txt", "1 0 0 0 0 0 1\n")
    texts = [text for sound, text in other_contents(tmp_path) if sound]
    assert len(texts) == 4
    assert "5 poses of YCB-Video in 1 videos" in texts[0]
    assert "stored poses of mine" in texts[1]
    assert "2 keyframes of 1 videos" in texts[3]


def test_millimetres_and_quaternions_that_are_none_are_problems(tmp_path):
    np.savez(tmp_path / "x_poses_by_video.npz", **{"0048/025_mug": np.full((3, 7), 800.0)})
    np.savetxt(tmp_path / "mug.xyz", np.random.default_rng(0).random((20, 3)) * 100)
    assert [sound for sound, _ in other_contents(tmp_path)] == [False, False]


def test_a_robot_says_the_unit_of_its_meshes_itself(tmp_path):
    (tmp_path / "arm" / "assets").mkdir(parents=True)
    trimesh.creation.box((300.0, 50, 50)).export(tmp_path / "arm" / "assets" / "link.stl")
    joint = "<body><joint/><geom/></body>"
    (tmp_path / "arm" / "arm.xml").write_text(
        f"<mujoco><default><joint/></default><worldbody>{joint}</worldbody></mujoco>"
    )
    (tmp_path / "arm" / "broken.xml").write_text("<mujoco>")
    assert list(other_contents(tmp_path)) == [
        (True, "arm.xml: a MuJoCo model of 1 bodies and 1 joints")
    ]


def test_clouds_and_loose_images_are_counted(tmp_path):
    rng = np.random.default_rng(0)
    np.savez(tmp_path / "clouds.npz", a=rng.random((200, 3)), b=rng.random((200, 3)), c=np.eye(3))
    np.save(tmp_path / "pickled.npy", np.array([{"a": 1}]), allow_pickle=True)
    (tmp_path / "x").mkdir()
    np.save(tmp_path / "nocs.npy", rng.random((2, 500, 3)) * 0.57)
    cv2.imwrite(str(tmp_path / "x" / "d.png"), np.full((8, 8), 700, np.uint16))
    cv2.imwrite(str(tmp_path / "x" / "c.png"), np.full((8, 8, 3), 70, np.uint8))
    clouds, normalised = (text for sound, text in other_contents(tmp_path) if sound)
    images = loose_images(tmp_path)
    assert "clouds.npz: 2 clouds of 200 points" in clouds
    assert "nocs.npy: 2 clouds of 500 points, normalised: diagonals 0.9" in normalised
    assert images.startswith("1 depth and 1 colour images,")
    assert "0.70 to 0.70 m away if in millimetres" in images


def test_frames_in_arrays_are_judged_by_their_distance(tmp_path):
    frame = {"image": np.zeros((4, 4, 3), np.uint8), "intrinsics_matrix": np.eye(3)}
    np.save(tmp_path / "a.npy", np.array(frame | {"depth": np.full((4, 4), 0.7)}, dtype=object))
    ((sound, text),) = other_contents(tmp_path)
    assert sound
    assert text.startswith("1 single frames in .npy files")
    assert "0.70 to 0.70 m" in text
    np.save(tmp_path / "b.npy", np.array(frame | {"depth": np.full((4, 4), 700.0)}, dtype=object))
    ((sound, _),) = other_contents(tmp_path)
    assert not sound


def test_a_damaged_archive_is_a_problem_that_hides_nothing_else(tmp_path):
    points = np.random.default_rng(0).random((200, 3))
    for name in ("a.npz", "b_poses_by_video.npz", "c.npz"):
        np.savez_compressed(tmp_path / name, points)
    content = (tmp_path / "a.npz").read_bytes()
    (tmp_path / "a.npz").write_bytes(content[:1000])
    (tmp_path / "b_poses_by_video.npz").write_bytes(content[:300] + bytes(100) + content[400:])
    told = list(other_contents(tmp_path))
    assert {text.split(":")[0].split("/")[-1] for sound, text in told if not sound} == {
        "a.npz",
        "b_poses_by_video.npz",
    }
    assert [text for sound, text in told if sound and "c.npz: 1 clouds" in text]


def test_images_beside_other_contents_are_not_passed_over(tmp_path):
    np.save(tmp_path / "clouds.npy", np.random.default_rng(0).random((200, 3)))
    cv2.imwrite(str(tmp_path / "d.png"), np.full((8, 8), 700, np.uint16))
    texts = [finding.text for finding in inspect_folder(tmp_path).findings]
    assert any(text.startswith("1 depth and 0 colour images") for text in texts)


def test_nothing_known_stays_a_problem(tmp_path):
    (tmp_path / "notes.txt").write_text("nothing")
    assert list(other_contents(tmp_path)) == []
    assert inspect_folder(tmp_path).problems == 1


@pytest.mark.parametrize(
    "folder",
    ["aerial", "meshes", "nocs_real275_objects", "shape_priors", "tabletop_frames"]
    + ["ycb_video_poses"],
)
def test_shared_folders_without_images_make_sense(folder):
    inspection = inspect_folder(shared_data(folder))
    assert inspection.problems == 0
    assert inspection.kind == "no images"
