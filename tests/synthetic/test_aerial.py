"""Recordings are the same from the same seed however they are made, and their truth is true."""

from pathlib import Path

import numpy as np
import pytest

from robust6dof.data import read_video
from robust6dof.data.truth_file import FILE_NAME, read_truth_file
from robust6dof.errors import DataError, InputError
from robust6dof.geometry.camera import backproject
from robust6dof.geometry.transforms import invert_transform, transform_points
from robust6dof.synthetic.aerial import plan_aerial, synthesize


def all_bytes(folder: Path) -> dict[str, bytes]:
    files = (f for f in folder.rglob("*") if f.is_file())
    return {str(f.relative_to(folder)): f.read_bytes() for f in files}


def test_two_shards_equal_one_run_and_whole_recordings_are_kept(tmp_path: Path) -> None:
    plans = plan_aerial(seed=3, sequences=8, frames=2)
    one = [synthesize(plan, tmp_path / "one") for plan in plans[6:8]]
    other = [synthesize(plan, tmp_path / "shards") for plan in reversed(plans[6:8])]
    for folder, again in zip(one, reversed(other), strict=True):
        assert all_bytes(folder) == all_bytes(again)
    marker = one[0] / "cam_K.txt"
    before = marker.stat().st_mtime_ns
    synthesize(plans[6], tmp_path / "one")
    assert marker.stat().st_mtime_ns == before
    (one[0] / "plan.json").unlink()
    synthesize(plans[6], tmp_path / "one")
    assert all_bytes(one[0]) == all_bytes(other[1]), "a torn recording is made again"


def test_the_first_recordings_of_a_longer_plan_are_the_same() -> None:
    assert plan_aerial(0, 20)[:6] == plan_aerial(0, 6)
    assert plan_aerial(0, 6) != plan_aerial(1, 6)
    assert {p.difficulty for p in plan_aerial(0, 18)} == {"calm", "agile", "harsh"}


def test_depth_and_mask_agree_with_the_true_pose_and_extents(tmp_path: Path) -> None:
    (plan,) = plan_aerial(
        seed=1, sequences=1, frames=3, categories=("mug",), difficulties=("agile",)
    )
    folder = synthesize(plan, tmp_path)
    video, truths = read_video(folder), read_truth_file(folder / FILE_NAME)
    assert len(video) == len(truths) == 3
    for index, truth in enumerate(truths):
        frame, mask = video[index], video.mask(index)
        assert mask is not None
        points_cam, _ = backproject(frame.depth, frame.K, mask)
        points_obj = transform_points(invert_transform(truth.T_cam_obj), points_cam)
        assert truth.extents is not None
        inside = (np.abs(points_obj) <= truth.extents / 2 + 0.01).all(axis=1)
        assert inside.mean() > 0.9, "the rest is noise at the outline"
        assert 0.1 < (truth.visible_fraction or 0) <= 1.0


def test_a_wrong_request_is_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="calm, agile, harsh"):
        plan_aerial(0, 3, difficulties=("wild",))
    with pytest.raises(DataError, match="no meshes"):
        plan_aerial(0, 3, meshes=tmp_path)
