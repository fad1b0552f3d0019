"""Recordings are the same from the same seed however they are made, and their truth is true."""

import json
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from robust6dof.cli.synthesize import Options, run
from robust6dof.data import read_video
from robust6dof.data.truth_file import FILE_NAME, read_truth_file
from robust6dof.errors import DataError, InputError
from robust6dof.geometry.camera import backproject
from robust6dof.geometry.transforms import invert_transform, transform_points
from robust6dof.shapes.loading import category_files
from robust6dof.synthetic.aerial import synthesize
from robust6dof.synthetic.plans import FIRST_TEST_SHAPE, plan_aerial, plan_split
from shared_data import shared_data


def all_bytes(folder: Path) -> dict[str, bytes]:
    files = (f for f in folder.rglob("*") if f.is_file())
    return {str(f.relative_to(folder)): f.read_bytes() for f in files}


def made(out: Path, **options: Any) -> list[dict[str, bytes]]:
    """What `robust6dof synthesize aerial` writes, recording by recording."""
    run(Options(world="aerial", out=out, seed=3, sequences=2, frames=2, **options))
    return [all_bytes(folder) for folder in sorted(out.iterdir())]


def test_two_shards_equal_one_run_and_whole_recordings_are_kept(tmp_path: Path) -> None:
    whole = made(tmp_path / "one")
    assert len(made(tmp_path / "shards", first=1, last=1)) == 1
    assert made(tmp_path / "shards", first=0, last=0) == whole

    folder = sorted((tmp_path / "one").iterdir())[0]
    before = (folder / "cam_K.txt").stat().st_mtime_ns
    made(tmp_path / "one")
    assert (folder / "cam_K.txt").stat().st_mtime_ns == before
    (folder / "plan.json").unlink()
    assert made(tmp_path / "one") == whole, "a torn recording is made again"


def test_a_gyro_is_added_and_nothing_else_changes(tmp_path: Path) -> None:
    bare = made(tmp_path / "bare")
    whole = made(tmp_path / "whole", gyro=True)
    assert made(tmp_path / "bare", gyro=True) == whole, "a kept recording gets one, too"
    assert all(recording.pop("gyro.csv") for recording in whole)
    assert whole == bare


def test_the_gyro_measures_the_true_turn_with_noise_and_bias(tmp_path: Path) -> None:
    (plan,) = plan_aerial(0, 1, 3, difficulties=("harsh",), categories=("can",))
    folder = synthesize(plan, tmp_path, gyro=True)
    stamp, *rate = np.loadtxt(folder / "gyro.csv", delimiter=",", skiprows=1).T
    motions = [json.loads(line) for line in (folder / "camera_motion.jsonl").open()]
    true = np.array([motion["camera_twist"][3:] for motion in motions])
    times = [frame.stamp or 0.0 for frame in read_video(folder)]
    measured = np.stack([np.interp(times, stamp, axis) for axis in rate], axis=-1)
    off_deg = np.degrees(np.abs(measured - true))
    assert 0.05 < off_deg.max() < 5.0
    assert all(frame.R_ref_cam is not None for frame in read_video(folder))


def test_the_first_recordings_of_a_longer_plan_are_the_same() -> None:
    assert plan_aerial(0, 20)[:6] == plan_aerial(0, 6)
    assert plan_aerial(0, 6) != plan_aerial(1, 6)
    assert {p.difficulty for p in plan_aerial(0, 18)} == {"calm", "agile", "harsh"}


@pytest.mark.parametrize(("split", "count"), [("mini", 18), ("full", 54)])
def test_a_split_has_every_category_at_every_difficulty_alike(split: str, count: int) -> None:
    plans = plan_split(split)
    assert len(plans) == count
    for values in ("name", "seed", "shape_seed"):
        assert len({getattr(plan, values) for plan in plans}) == count
    kinds = Counter((plan.category, plan.difficulty) for plan in plans)
    assert len(kinds) == 18
    assert set(kinds.values()) == {count // 18}
    assert min(plan.shape_seed for plan in plans) >= FIRST_TEST_SHAPE
    assert not {p.seed for p in plan_split("mini")} & {p.seed for p in plan_split("full")}


def test_the_mesh_variant_goes_through_all_meshes() -> None:
    meshes = shared_data("meshes")
    plans = plan_split("full", meshes)
    for category in ("mug", "laptop"):
        used = {plan.mesh for plan in plans if plan.category == category}
        assert used == set(category_files(meshes, category))


def test_what_is_lost_has_no_twin_beside_it(tmp_path: Path) -> None:
    for name in ("a", "b", "c"):
        (tmp_path / "mug" / name).mkdir(parents=True)
        (tmp_path / "mug" / name / "model.obj").touch()
    plans = plan_aerial(0, 3, difficulties=("leaving",), categories=("mug",), meshes=tmp_path)
    assert all(len(plan.alike) == 2 and plan.mesh not in plan.alike for plan in plans)
    (plan,) = plan_aerial(0, 1, difficulties=("harsh",), categories=("mug",), meshes=tmp_path)
    assert plan.mesh in plan.alike


def test_depth_and_mask_agree_with_the_true_pose_and_extents(tmp_path: Path) -> None:
    (plan,) = plan_aerial(
        seed=1, sequences=1, frames=3, categories=("mug",), difficulties=("agile",)
    )
    folder = synthesize(plan, tmp_path / "a set" / "not there yet")
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
    with pytest.raises(InputError, match=r"teapot.*--meshes"):
        plan_aerial(0, 3, categories=("teapot",))
    with pytest.raises(InputError, match="mini, full"):
        plan_split("huge")
    with pytest.raises(InputError, match="--frames"):
        run(Options(world="aerial", out=tmp_path, split="mini", frames=10))
