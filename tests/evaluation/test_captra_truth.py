"""CAPTRA's own truth: NOCS poses fitted anew to coordinate maps and depth."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from data.nocs_files import annotated, make_instances, write_frame, write_pickle
from robust6dof.data.image_files import write_image
from robust6dof.data.nocs import BACKGROUND, K_REAL, open_nocs
from robust6dof.errors import DataError
from robust6dof.evaluation.captra_truth import BORDER_PX, fit_truth, without_border
from robust6dof.evaluation.protocols import PROTOCOLS
from robust6dof.geometry.camera import backproject
from robust6dof.geometry.transforms import invert_transform, make_transform, transform_points

SCALE = 0.3


def fitted_pose(one):
    """Near the middle of the instance's pixels; the official truth is another."""
    rows, columns = one.rows, one.columns
    middle = np.array([(columns.start + columns.stop) / 2, (rows.start + rows.stop) / 2, 1.0])
    return make_transform(one.T_cam_obj[:3, :3], np.linalg.inv(K_REAL) @ middle)


@pytest.fixture
def scene(tmp_path):
    """Coordinate maps that tell of `fitted_pose`, wrong in a third of the pixels."""
    rng = np.random.default_rng(0)
    instances = make_instances()
    folder = tmp_path / "real_test" / "scene_1"
    depth = write_frame(folder, "0003", instances).astype(float) / 1000
    coordinates = np.zeros((*depth.shape, 3))
    for one in annotated(instances):
        mask = np.zeros(depth.shape, bool)
        mask[one.rows, one.columns] = True
        points, pixels = backproject(depth, K_REAL, mask)
        canonical = transform_points(invert_transform(fitted_pose(one)), points) / SCALE + 0.5
        wrong = rng.random(len(points)) < 1 / 3
        canonical[wrong] = rng.random((wrong.sum(), 3))
        x, y = pixels.astype(int).T
        coordinates[y, x] = canonical
    assert coordinates.min() >= 0
    assert coordinates.max() <= 1
    coordinates[..., 2] = 1 - coordinates[..., 2]
    write_image(folder / "0003_coord.png", np.rint(255 * coordinates).astype(np.uint8))
    RTs = np.stack([one.RT for one in annotated(instances)])
    gts = {"gt_RTs": RTs, "image_path": "real/test/scene_1/0003"}
    write_pickle(tmp_path / "gts/real_test/results_real_test_scene_1_0003.pkl", gts)
    sizes = tmp_path / "obj_models" / "real_test"
    sizes.mkdir(parents=True)
    for one in instances:
        np.savetxt(sizes / f"{one.model}.txt", one.extents[None])
    return tmp_path


def test_captra_takes_the_maps_word_and_the_others_the_official_one(scene):
    dataset = open_nocs(scene)
    official = PROTOCOLS["nocs-map"].truth(dataset).sequences[0].truth(0)
    refitted = PROTOCOLS["captra"].truth(dataset).sequences[0].truth(0)
    assert [truth.name for truth in refitted] == [truth.name for truth in official]
    for truth, one in zip(refitted, annotated(make_instances()), strict=True):
        off = invert_transform(fitted_pose(one)) @ truth.T_cam_obj
        assert np.degrees(Rotation.from_matrix(off[:3, :3]).magnitude()) < 1.0
        assert np.linalg.norm(off[:3, 3]) < 0.003
        assert np.linalg.norm(truth.extents) == pytest.approx(SCALE, rel=0.02)
        np.testing.assert_allclose(truth.extents / one.extents, truth.extents[0] / one.extents[0])
    assert np.linalg.norm(official[0].T_cam_obj - refitted[0].T_cam_obj) > 0.02


def test_the_border_is_that_of_the_loop():
    rng = np.random.default_rng(1)
    ids = np.where(rng.random((30, 40)) < 0.03, BACKGROUND, 3).astype(np.uint8)
    expected = ids.copy()
    for i, j in np.argwhere(ids == BACKGROUND):
        rows = slice(max(0, i - BORDER_PX), i + BORDER_PX)
        expected[rows, max(0, j - BORDER_PX) : j + BORDER_PX] = BACKGROUND
    np.testing.assert_array_equal(without_border(ids), expected)


def test_instances_without_pixels_or_without_agreement_are_left_out(scene):
    folder = scene / "real_test" / "scene_1"
    ids = cv2.imread(str(folder / "0003_mask.png"), cv2.IMREAD_UNCHANGED)
    ids[ids == 3] = BACKGROUND
    ids[0, 0] = 3
    write_image(folder / "0003_mask.png", ids)
    (left,) = PROTOCOLS["captra"].truth(open_nocs(scene)).sequences[0].truth(0)
    assert left.name.startswith("bowl")
    rng = np.random.default_rng(2)
    assert fit_truth(rng.random((50, 3)), rng.random((50, 3)) * 50) is None


def test_without_coordinate_maps_it_says_so(scene):
    (scene / "real_test" / "scene_1" / "0003_coord.png").unlink()
    with pytest.raises(DataError, match="0003_coord"):
        PROTOCOLS["captra"].truth(open_nocs(scene)).sequences[0].truth(0)


def test_recordings_keep_their_truth(tmp_path):
    from evaluation.small_recordings import write_recording
    from robust6dof.data.truth_file import open_with_truth

    write_recording(tmp_path / "a")
    dataset = open_with_truth(tmp_path)
    assert PROTOCOLS["captra"].truth(dataset).sequences == dataset.sequences
