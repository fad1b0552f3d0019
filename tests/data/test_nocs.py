"""NOCS in both layouts, written by the tests as it is published, and its real frame."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from data.nocs_files import (
    Instance,
    annotated,
    make_instances,
    write_camera_depth,
    write_frame,
    write_pickle,
)
from robust6dof.data.image_files import write_image
from robust6dof.data.nocs import K_CAMERA, K_REAL, open_nocs
from robust6dof.data.nocs_truth import FAULTY_MUG
from robust6dof.errors import DataError
from robust6dof.geometry.camera import backproject
from robust6dof.geometry.transforms import invert_transform, transform_points
from shared_data import shared_data


def write_real_gts(root: Path, instances: list[Instance], frame: str = "0003") -> Path:
    """real_test's pickles hold the poses and the image's path alone."""
    path = root / "gts" / "real_test" / f"results_real_test_scene_1_{frame}.pkl"
    RTs = np.stack([one.RT for one in annotated(instances)])
    write_pickle(path, {"gt_RTs": RTs, "image_path": "data/real/test/scene_1/0003"})
    return path


@pytest.fixture(params=["real_test", "Real/test", "data/Real/test"])
def real_test(request: pytest.FixtureRequest, tmp_path: Path) -> tuple[Path, Path]:
    """REAL275's test split: the root to open, and the folder beside which `gts` lies."""
    write_frame(tmp_path / request.param / "scene_1", "0003", make_instances())
    root = tmp_path / "data" if request.param.startswith("data/") else tmp_path
    write_real_gts(root, make_instances())
    sizes = root / "obj_models" / "real_test"
    sizes.mkdir(parents=True)
    for one in make_instances():
        np.savetxt(sizes / f"{one.model}.txt", one.extents[None])
    return tmp_path, root


def assert_truth(truths: tuple, instances: list[Instance]) -> None:
    expected = annotated(instances)
    assert [truth.name for truth in truths] == [one.model for one in expected]
    for truth, one in zip(truths, expected, strict=True):
        np.testing.assert_allclose(truth.T_cam_obj, one.T_cam_obj, atol=1e-6)
        np.testing.assert_allclose(truth.extents, one.extents, rtol=1e-6)
        assert truth.instance_id == one.instance_id
        assert truth.mask[one.rows, one.columns].all()
        assert truth.mask.sum() == (one.rows.stop - one.rows.start) * (
            one.columns.stop - one.columns.start
        )


def test_real_test_in_each_layout(real_test: tuple[Path, Path]) -> None:
    dataset = open_nocs(real_test[0])
    assert dataset.name == "nocs-real_test"
    sequence = dataset.sequence("scene_1")
    assert sequence.frame_names == ("0003",)
    frame = sequence.frame(0)
    np.testing.assert_array_equal(frame.K, K_REAL)
    assert frame.depth[0, 0] == 0
    assert abs(frame.depth[400, 401] - 1.05) < 1e-6
    truths = sequence.truth(0)
    assert_truth(truths, make_instances())
    assert [truth.category for truth in truths] == ["bowl", "mug"]
    assert all(truth.handle_visible for truth in truths)


def test_order_is_by_instance_id_not_by_line(real_test: tuple[Path, Path]) -> None:
    """With the meta file's order reversed the truth stays the same."""
    path, _ = real_test
    meta = next(path.glob("**/0003_meta.txt"))
    meta.write_text("\n".join(reversed(meta.read_text().splitlines())))
    assert_truth(open_nocs(path).sequences[0].truth(0), make_instances())


def test_poses_that_do_not_fit_the_mask_are_refused(real_test: tuple[Path, Path]) -> None:
    path, root = real_test
    gts = write_real_gts(root, make_instances()[:1])
    with pytest.raises(DataError, match="1 poses for 2 objects") as caught:
        open_nocs(path).sequences[0].truth(0)
    assert caught.value.path.resolve() == gts.resolve()


def test_sheared_poses_are_refused(real_test: tuple[Path, Path]) -> None:
    path, root = real_test
    instances = make_instances()
    instances[0].T_cam_obj[0, 0] += 0.3
    write_real_gts(root, instances)
    with pytest.raises(DataError, match=r"mug_anastasia_norm: .*not a rotation"):
        open_nocs(path).sequences[0].truth(0)


def test_handle_visibility_of_spd_results_goes_by_box(real_test: tuple[Path, Path]) -> None:
    """The stored results list objects in an order of their own."""
    path, root = real_test
    bowl, mug = annotated(make_instances())
    results = root / "results" / "nocs_results" / "real_test" / "results_test_scene_1_0003.pkl"
    content = {
        "gt_class_ids": np.array([6, 2, 6]),
        "gt_bboxes": np.array([[0, 0, 9, 9], bowl.box, np.add(mug.box, [0, 1, 1, 0])]),
        "gt_handle_visibility": np.array([1, 1, 0]),
    }
    write_pickle(results, content)
    truths = open_nocs(path).sequences[0].truth(0)
    assert [truth.handle_visible for truth in truths] == [True, False]


def test_spd_labels_are_read_where_there_is_no_gts(tmp_path: Path) -> None:
    instances = make_instances()
    folder = tmp_path / "Real" / "train" / "scene_1"
    write_frame(folder, "0000", instances)
    order = list(reversed(annotated(instances)))
    label = {
        "class_ids": [one.class_id for one in order],
        "bboxes": np.array([one.box for one in order]),
        "scales": np.array([one.scale for one in order], np.float32),
        "rotations": np.array([one.T_cam_obj[:3, :3] for one in order], np.float32),
        "translations": np.array([one.T_cam_obj[:3, 3] for one in order], np.float32),
        "instance_ids": [one.instance_id for one in order],
        "model_list": [one.model for one in order],
        "size": np.array([one.extents / one.scale for one in order]),
        "handle_visibility": np.array([0, 1]),
    }
    write_pickle(folder / "0000_label.pkl", label)
    dataset = open_nocs(tmp_path)
    assert dataset.name == "nocs-real_train"
    truths = dataset.sequences[0].truth(0)
    assert_truth(truths, instances)
    assert [truth.handle_visible for truth in truths] == [True, False]


@pytest.mark.parametrize("images", ["val", "CAMERA/val"])
def test_camera_with_composed_depth(tmp_path: Path, images: str) -> None:
    instances = make_instances()
    instances[0].model = "a" * 32
    depth = write_frame(tmp_path / images / "00007", "0002", instances, camera=True)
    kept = annotated(instances)
    gts = {
        "gt_RTs": np.stack([one.RT for one in kept]),
        "gt_scales": np.stack([one.extents / one.scale for one in kept]),
        "gt_bboxes": np.array([one.box for one in kept]),
        "gt_class_ids": np.array([one.class_id for one in kept]),
        "image_id": 72,
        "obj_list": [one.model for one in kept],
        "handle_visibility": np.array([1, 0]),
    }
    write_pickle(tmp_path / "gts" / "val" / "results_val_00007_0002.pkl", gts)
    sequence = open_nocs(tmp_path).sequences[0]
    with pytest.raises(DataError, match=r"camera_full_depths\.zip"):
        sequence.frame(0)
    composed = tmp_path / "camera_full_depths" / "val" / "00007" / "0002_composed.png"
    write_camera_depth(composed, depth)
    frame = sequence.frame(0)
    np.testing.assert_array_equal(frame.K, K_CAMERA)
    np.testing.assert_allclose(frame.depth, depth / 1000.0, atol=1e-6)
    truths = sequence.truth(0)
    assert_truth(truths, instances)
    assert [truth.handle_visible for truth in truths] == [True, False]


@pytest.mark.parametrize("in_gts", [True, False])
def test_the_faulty_mug_is_left_out(tmp_path: Path, in_gts: bool) -> None:
    instances = make_instances()
    instances[0].model = FAULTY_MUG
    write_frame(tmp_path / "val" / "00000", "0000", instances, camera=True)
    kept = [one for one in annotated(instances) if in_gts or one.model != FAULTY_MUG]
    gts = {
        "gt_RTs": np.stack([one.RT for one in kept]),
        "gt_scales": np.stack([one.extents / one.scale for one in kept]),
    }
    write_pickle(tmp_path / "gts" / "val" / "results_val_00000_0000.pkl", gts)
    truths = open_nocs(tmp_path).sequences[0].truth(0)
    assert [truth.name for truth in truths] == ["bowl_white_small_norm"]
    np.testing.assert_allclose(truths[0].T_cam_obj, instances[3].T_cam_obj, atol=1e-6)


def test_coordinates_have_z_flipped(real_test: tuple[Path, Path]) -> None:
    sequence = open_nocs(real_test[0]).sequences[0]
    coordinates = sequence.coordinates(0)  # pyright: ignore[reportAttributeAccessIssue]
    np.testing.assert_allclose(coordinates[300, 250], [30 / 255, 128 / 255, 1 - 200 / 255])


def test_a_foreign_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"no NOCS images of any split.*real_test"):
        open_nocs(tmp_path)
    write_frame(tmp_path / "real_test" / "scene_1", "0000", make_instances())
    with pytest.raises(DataError, match=r"no NOCS images of camera_val.*CAMERA/val"):
        open_nocs(tmp_path, "camera_val")


def test_false_meta_files_are_named(real_test: tuple[Path, Path]) -> None:
    next(real_test[0].glob("**/0003_meta.txt")).write_text("one 6 mug\n")
    with pytest.raises(DataError, match=r"0003_meta\.txt: not a NOCS meta file"):
        open_nocs(real_test[0]).sequences[0].truth(0)


def test_the_real_frame_in_the_published_layout(tmp_path: Path) -> None:
    """Images as they are, annotations from the derived poses in the official files' form."""
    source = shared_data("nocs_real275_frame")
    derived = json.loads((source / "derived_reference_poses.json").read_text())["objects"]
    folder = tmp_path / "real_test" / "scene_6"
    folder.mkdir(parents=True)
    for kind in ("color", "depth"):
        (folder / f"0000_{kind}.png").write_bytes((source / f"0000_{kind}.png").read_bytes())
    ids, lines, RTs = np.full((480, 640), 255, np.uint8), [], []
    for number, (name, fields) in enumerate(derived.items(), start=1):
        x1, y1, x2, y2 = fields["box_xyxy"]
        ids[y1:y2, x1:x2] = number
        categories = ("bottle", "bowl", "camera", "can", "laptop", "mug")
        lines.append(f"{number} {1 + categories.index(name.split('_')[0])} {name}")
        RT = np.eye(4)
        RT[:3, :3] = fields["scale_m"] * np.array(fields["R"])
        RT[:3, 3] = fields["t_m"]
        RTs.append(RT)
        sizes = tmp_path / "obj_models" / "real_test"
        sizes.mkdir(parents=True, exist_ok=True)
        np.savetxt(sizes / f"{name}.txt", [fields["size_m"]])
    write_image(folder / "0000_mask.png", ids)
    (folder / "0000_meta.txt").write_text("\n".join(lines))
    gts = {"gt_RTs": np.stack(RTs), "image_path": "real/test/scene_6/0000"}
    write_pickle(tmp_path / "gts/real_test/results_real_test_scene_6_0000.pkl", gts)
    sequence = open_nocs(tmp_path).sequence("scene_6")
    frame, truths = sequence.frame(0), sequence.truth(0)
    assert len(truths) == 6
    for truth in truths:
        assert truth.extents is not None
        points, _ = backproject(frame.depth, frame.K, truth.mask)
        points_obj = transform_points(invert_transform(truth.T_cam_obj), points)
        inside = (np.abs(points_obj) < truth.extents / 2 + 0.01).all(axis=1)
        assert inside.mean() > 0.3, truth.name
