"""Recordings in both layouts: what is read, and that each fault is named with its remedy."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest

from data.recordings import (
    HEIGHT,
    WIDTH,
    K,
    make_frame,
    make_mask,
    make_recording,
    make_T_cam_obj,
)
from robust6dof.data import Video, read_video
from robust6dof.data.image_files import write_image
from robust6dof.errors import DataError, InputError, Robust6dofWarning
from robust6dof.geometry.camera import backproject
from robust6dof.geometry.transforms import invert_transform, transform_points
from shared_data import shared_data


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    return make_recording(tmp_path / "video")


@pytest.fixture
def seven_scenes(tmp_path: Path) -> Path:
    """Two frames as 7-Scenes has them, in `data/`."""
    folder = tmp_path / "kitchen" / "data"
    folder.mkdir(parents=True)
    np.savetxt(folder.parent / "camera-intrinsics.txt", K)
    for index in (7, 12):
        name = f"frame-{index:06d}"
        frame = make_frame(index)
        depth = np.rint(frame.depth * 1000).astype(np.uint16)
        depth[frame.depth == 0] = 65535
        write_image(folder / f"{name}.color.jpg", frame.rgb)
        write_image(folder / f"{name}.depth.png", depth)
        np.savetxt(folder / f"{name}.pose.txt", make_T_cam_obj(index))
    return folder.parent


def assert_refused(path: Path, words: str, **options: object) -> DataError:
    with pytest.raises(DataError, match=words) as caught:
        list(read_video(path, **options))  # pyright: ignore[reportArgumentType]
    return caught.value


def test_round_trip(recording: Path) -> None:
    video = read_video(recording)
    assert len(video) == 3
    assert video.names == ("97", "100", "103")
    for index, frame in enumerate(video):
        expected = make_frame(index)
        np.testing.assert_array_equal(frame.rgb, expected.rgb)
        np.testing.assert_allclose(frame.depth, expected.depth, atol=5.01e-4)
        assert frame.depth[0, 0] == 0
        np.testing.assert_allclose(frame.K, K)
        np.testing.assert_array_equal(video.mask(index), make_mask(index))
        np.testing.assert_allclose(video.annotated_pose(index), make_T_cam_obj(index), atol=1e-8)
        assert video.camera_pose(index) is None


def test_slices_are_videos_and_keep_names_and_annotations(recording: Path) -> None:
    video = read_video(recording)[1:]
    assert isinstance(video, Video)
    assert [frame.name for frame in video] == ["100", "103"]
    np.testing.assert_array_equal(video.mask(0), make_mask(1))
    assert video[-1].name == "103"
    assert len(video[5:]) == 0


def test_frames_are_read_only_when_asked_for(recording: Path) -> None:
    video = read_video(recording)
    (recording / "rgb" / "103.png").unlink()
    assert video[1].name == "100"
    with pytest.raises(DataError, match="missing"):
        video[2]


def test_masks_and_poses_may_be_missing_or_have_three_channels(recording: Path) -> None:
    (recording / "masks" / "100.png").unlink()
    shutil.rmtree(recording / "annotated_poses")
    write_image(
        recording / "masks" / "97.png", np.stack([255 * make_mask().astype(np.uint8)] * 3, -1)
    )
    video = read_video(recording)
    assert video.mask(1) is None
    assert video.annotated_pose(0) is None
    np.testing.assert_array_equal(video.mask(0), make_mask(0))


def test_numbered_poses_go_with_the_frames_by_order(recording: Path) -> None:
    """YCBInEOAT names images by time and poses by number."""
    folder = recording / "annotated_poses"
    for index, name in enumerate(("97", "100", "103")):
        (folder / f"{name}.txt").rename(folder / f"{index:07d}.txt")
    video = read_video(recording)
    np.testing.assert_allclose(video.annotated_pose(1), make_T_cam_obj(1), atol=1e-8)
    (folder / "0000002.txt").unlink()
    assert_refused(recording, "2 poses for 3 frames, and no name in common")


def test_seven_scenes_layout(seven_scenes: Path) -> None:
    for path in (seven_scenes, seven_scenes / "data"):
        video = read_video(path)
        assert video.names == ("frame-000007", "frame-000012")
        frame = video[1]
        np.testing.assert_allclose(frame.depth, make_frame(12).depth, atol=5.01e-4)
        np.testing.assert_allclose(video.camera_pose(1), make_T_cam_obj(12), atol=1e-6)
    np.savetxt(seven_scenes / "data" / "frame-000012.pose.txt", np.full((4, 4), -np.inf))
    assert read_video(seven_scenes).camera_pose(1) is None


def test_depth_only_carries_no_colour(seven_scenes: Path) -> None:
    for file in (seven_scenes / "data").glob("*.color.jpg"):
        file.unlink()
    assert_refused(seven_scenes, "no colour.*depth_only=True")
    frame = read_video(seven_scenes, depth_only=True)[0]
    assert not frame.has_color
    assert not frame.rgb.any()
    np.testing.assert_allclose(frame.depth, make_frame(7).depth, atol=5.01e-4)


def test_stamps_from_file_or_rate(recording: Path) -> None:
    assert read_video(recording)[1].stamp is None
    assert [frame.stamp for frame in read_video(recording, fps=20)] == [0.0, 0.05, 0.1]
    (recording / "stamps.txt").write_text("97 1.5\n103 1.75\n100 1.625\n")
    assert [frame.stamp for frame in read_video(recording)] == [1.5, 1.625, 1.75]
    (recording / "stamps.txt").write_text("1.5\n1.625\n1.75\n")
    assert read_video(recording)[1:][0].stamp == 1.625
    with pytest.raises(InputError, match="fps"):
        read_video(recording, fps=0)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("97 1\n100 2\n", "no time for frame '103'"),
        ("1\n2\n", "2 times for 3 frames"),
        ("1\n3\n2\n", "do not increase"),
        ("noon\n1\n2\n", "not a list of times"),
    ],
)
def test_wrong_stamps_are_refused(recording: Path, text: str, words: str) -> None:
    (recording / "stamps.txt").write_text(text)
    assert assert_refused(recording, words).path.name == "stamps.txt"


def test_unknown_layouts_say_what_was_looked_for(tmp_path: Path) -> None:
    assert_refused(tmp_path / "nowhere", "no such folder")
    (tmp_path / "movie.mp4").write_bytes(b"")
    assert_refused(tmp_path / "movie.mp4", "not a folder")
    assert_refused(tmp_path, r"no layout.*cam_K\.txt.*camera-intrinsics\.txt")


def test_no_frames(recording: Path) -> None:
    for file in [*(recording / "rgb").iterdir(), *(recording / "depth").iterdir()]:
        file.unlink()
    assert_refused(recording, "there are no frames")


def test_colour_without_depth_names_the_frame(recording: Path) -> None:
    (recording / "depth" / "100.png").unlink()
    assert assert_refused(recording, "1 of 3 colour frames").path.name == "100.png"


def test_depth_without_colour_is_ignored_aloud(recording: Path) -> None:
    (recording / "rgb" / "100.png").unlink()
    with pytest.warns(Robust6dofWarning, match="1 depth images without colour"):
        assert read_video(recording).names == ("97", "103")


@pytest.mark.parametrize("part", ["rgb/97.png", "depth/97.png"])
@pytest.mark.parametrize("kept", [0, 40, 0.6])
def test_truncated_images_are_named(recording: Path, part: str, kept: float) -> None:
    content = (recording / part).read_bytes()
    size = int(kept * len(content)) if kept < 1 else int(kept)
    (recording / part).write_bytes(content[:size])
    assert assert_refused(recording, "truncated or not an image").path == recording / part


def test_a_truncated_jpeg_is_not_greyed(seven_scenes: Path) -> None:
    file = seven_scenes / "data" / "frame-000007.color.jpg"
    file.write_bytes(file.read_bytes()[:-200])
    assert assert_refused(seven_scenes, "truncated").path == file


@pytest.mark.parametrize(
    ("image", "words"),
    [
        (np.full((HEIGHT, WIDTH), 80, np.uint8), "picture of depth"),
        (np.full((HEIGHT, WIDTH, 3), 80, np.uint8), "picture of depth"),
    ],
)
def test_pictures_of_depth_are_refused(recording: Path, image: np.ndarray, words: str) -> None:
    write_image(recording / "depth" / "97.png", image)
    assert_refused(recording, f"{words}.*16-bit")


@pytest.mark.parametrize(
    ("unit_m", "words"),
    [
        (1.0, "depth_unit_m=1.0"),
        (0.01, "depth_unit_m=1.0 or 0.01"),
        (0.0001, "depth_unit_m=0.0001"),
        (0.0002, "0.0002"),
    ],
)
def test_wrong_units_are_refused_and_their_remedy_works(
    recording: Path, unit_m: float, words: str
) -> None:
    for index, file in enumerate(
        sorted((recording / "depth").iterdir(), key=lambda f: int(f.stem))
    ):
        write_image(file, np.rint(make_frame(index).depth / unit_m).astype(np.uint16))
    assert assert_refused(recording, words).path.parent.name == "depth"
    depth = read_video(recording, depth_unit_m=unit_m)[0].depth
    np.testing.assert_allclose(depth, make_frame(0).depth, atol=0.501 * unit_m)


def test_an_empty_first_frame_does_not_hide_a_wrong_unit(recording: Path) -> None:
    write_image(recording / "depth" / "97.png", np.zeros((HEIGHT, WIDTH), np.uint16))
    read_video(recording)
    for name in ("100", "103"):
        write_image(recording / "depth" / f"{name}.png", np.full((HEIGHT, WIDTH), 9000, np.uint16))
    assert_refused(recording, "would lie beyond 9 m")


@pytest.mark.parametrize("factor", [0.5, 2.0, 1.0 / WIDTH])
def test_intrinsics_of_another_size_are_refused(recording: Path, factor: float) -> None:
    np.savetxt(recording / "cam_K.txt", np.diag([factor, factor, 1.0]) @ K)
    assert assert_refused(recording, f"{WIDTH}×{HEIGHT}").path.name == "cam_K.txt"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("60 0 31.5 0 61 23.5", "6 numbers where 3×3"),
        ("fx 60 fy 61", "not a file of numbers"),
        ("60 0 0 0 61 0 31.5 23.5 1", "row by row"),
        ("nan 0 31.5 0 61 23.5 0 0 1", "finite"),
    ],
)
def test_unreadable_intrinsics_are_refused(recording: Path, text: str, words: str) -> None:
    (recording / "cam_K.txt").write_text(text)
    assert assert_refused(recording, words).path.name == "cam_K.txt"


def test_missing_intrinsics_are_refused(recording: Path, seven_scenes: Path) -> None:
    (recording / "cam_K.txt").unlink()
    assert_refused(recording, r"cam_K\.txt: the intrinsics are missing")
    (seven_scenes / "camera-intrinsics.txt").unlink()
    assert_refused(seven_scenes, r"camera-intrinsics\.txt: the intrinsics are missing")


def test_masks_of_another_size_and_false_poses_are_refused(recording: Path) -> None:
    write_image(recording / "masks" / "97.png", np.zeros((10, 12), np.uint8))
    np.savetxt(recording / "annotated_poses" / "97.txt", 0.2 * make_T_cam_obj())
    video = read_video(recording)
    with pytest.raises(DataError, match="the mask is 12×10 but its image is 64×48"):
        video.mask(0)
    with pytest.raises(DataError, match=r"97\.txt.*last row"):
        video.annotated_pose(0)


class TestSeparateDepthCamera:
    """Depth of half the size, 5 cm to the left of the colour camera."""

    K_depth = np.array([[30.0, 0.0, 15.5], [0.0, 30.0, 11.5], [0.0, 0.0, 1.0]])
    T_color_depth = np.eye(4)
    T_color_depth[0, 3] = -0.05

    @pytest.fixture
    def separate(self, recording: Path) -> Path:
        for file in (recording / "depth").iterdir():
            write_image(file, np.full((HEIGHT // 2, WIDTH // 2), 1000, np.uint16))
        return recording

    def test_is_refused_until_calibrated(self, separate: Path) -> None:
        assert_refused(
            separate, r"depth is 32×24 but colour is 64×48.*T_color_depth\.txt.*depth_only"
        )
        assert_refused(separate, "only cam_K_depth is known", K_depth=self.K_depth)
        np.savetxt(separate / "T_color_depth.txt", self.T_color_depth)
        assert_refused(separate, "only T_color_depth is known")
        assert_refused(separate, "its camera is unknown", depth_only=True)

    def test_is_registered_by_files_or_options(self, separate: Path) -> None:
        options = {"K_depth": self.K_depth, "T_color_depth": self.T_color_depth}
        by_options = read_video(separate, **options)[0]
        np.savetxt(separate / "cam_K_depth.txt", self.K_depth)
        np.savetxt(separate / "T_color_depth.txt", self.T_color_depth)
        by_files = read_video(separate)[0]
        np.testing.assert_array_equal(by_options.depth, by_files.depth)
        assert by_files.depth.shape == (HEIGHT, WIDTH)
        np.testing.assert_allclose(by_files.depth[5:-5, 5:50], 1.0, atol=1e-6)

    def test_depth_only_stands_in_the_depth_camera(self, separate: Path) -> None:
        np.savetxt(separate / "cam_K_depth.txt", self.K_depth)
        np.savetxt(separate / "T_color_depth.txt", self.T_color_depth)
        video = read_video(separate, depth_only=True)
        assert video[0].depth.shape == (HEIGHT // 2, WIDTH // 2)
        np.testing.assert_allclose(video[0].K, self.K_depth)
        T_depth_obj = invert_transform(self.T_color_depth) @ make_T_cam_obj(1)
        np.testing.assert_allclose(video.annotated_pose(1), T_depth_obj, atol=1e-8)
        with pytest.raises(DataError, match="64×48"):
            video.mask(0)


class TestLens:
    coefficients = np.array([-0.25, 0.05, 0.001, -0.002, 0.0])

    def test_is_undone(self, recording: Path) -> None:
        np.savetxt(recording / "dist_coeffs.txt", self.coefficients[None])
        raw, video = make_frame(1), read_video(recording)
        expected = cv2.undistort(raw.rgb, K, self.coefficients)
        np.testing.assert_allclose(video[1].rgb[3:-3, 3:-3], expected[3:-3, 3:-3], atol=2)
        by_option = read_video(recording, dist_coeffs=self.coefficients)[1]
        np.testing.assert_array_equal(by_option.depth, video[1].depth)
        assert not np.allclose(video[1].depth, raw.depth, atol=0.001)
        assert video.mask(0) is not None

    def test_depth_follows_the_lens_as_colour_does(self, recording: Path) -> None:
        frame = read_video(recording, dist_coeffs=self.coefficients)[0]
        pixels = np.array([[10.0, 8.0], [50.0, 40.0], [32.0, 24.0]])
        rays = (pixels - K[:2, 2]) / K[[0, 1], [0, 1]]
        points = np.concatenate([rays, np.ones((3, 1))], axis=1)
        distorted, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), K, self.coefficients)
        x, y = np.rint(distorted[:, 0].T).astype(int)
        columns, rows = pixels.astype(int).T
        raw = np.rint(make_frame(0).depth * 1000) / 1000
        np.testing.assert_allclose(frame.depth[rows, columns], raw[y, x], atol=1e-6)

    def test_zero_coefficients_change_nothing(self, recording: Path) -> None:
        (recording / "dist_coeffs.txt").write_text("inverse_brown_conrady 0 0 0 0 0")
        np.testing.assert_array_equal(read_video(recording)[0].rgb, make_frame(0).rgb)

    @pytest.mark.parametrize(
        ("text", "words"),
        [
            ("equidistant 0.1 0.2 0 0", "lens model 'equidistant' is not understood"),
            ("0.1 0.2 0.3", "3 distortion coefficients"),
            ("plumb_bob 0.1 0.2 zero 0", "could not convert"),
        ],
    )
    def test_other_models_are_refused(self, recording: Path, text: str, words: str) -> None:
        (recording / "dist_coeffs.txt").write_text(text)
        assert assert_refused(recording, words).path.name == "dist_coeffs.txt"


def test_real_seven_scenes_recording_shows_the_mug_where_the_reference_has_it() -> None:
    """The cloud about the reference pose must be as high and wide as the mug (2 cm of drift)."""
    path = shared_data("seven_scenes_mugs")
    reference = json.loads((path / "derived_mug_reference.json").read_text())
    video = read_video(path, depth_only=True, fps=30)
    assert len(video) == 212
    assert (video[0].stamp, video[30].stamp) == (0.0, 1.0)
    index = video.names.index("frame-000300")
    frame = video[index]
    assert frame.depth.max() < 10
    poses = reference["frames_object_to_camera"]
    key = next(key for key in poses if int(key.rsplit("-", 1)[-1]) == 300)
    T_cam_obj = np.array(poses[key]["A"])
    points_cam, _ = backproject(frame.depth, frame.K)
    points_obj = transform_points(invert_transform(T_cam_obj), points_cam)
    mug = reference["mugs"]["A"]
    inside = np.abs(points_obj[:, 1]) < mug["height_m"] / 2 - 0.01
    radii = np.linalg.norm(points_obj[:, [0, 2]], axis=1)[inside]
    wall = radii[radii < 2 * mug["radius_m"]]
    assert len(wall) > 100
    assert abs(np.median(wall) - mug["radius_m"]) < 0.02
