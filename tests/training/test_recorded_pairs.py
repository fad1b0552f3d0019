"""Pairs from recordings on disk say what is true of their frames, and learn from no test data."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import scipy.io
import torch

from data.nocs_files import Instance, write_frame, write_pickle
from robust6dof.data.image_files import write_image
from robust6dof.data.nocs import K_REAL
from robust6dof.data.ycb_video import K_FIRST
from robust6dof.errors import DataError, InputError, Robust6dofWarning
from robust6dof.frames import YCB_OBJECTS
from robust6dof.geometry.camera import project
from robust6dof.geometry.transforms import make_transform
from robust6dof.network.config import preset
from robust6dof.network.inputs import to_camera
from robust6dof.shapes.ycb_objects import R_YCBV_OBJ, YCB_SIDES_M
from robust6dof.tracking.view import ViewConfig
from robust6dof.training.loop import TrainConfig, train
from robust6dof.training.pair_sets import make_recorded_sets
from robust6dof.training.recipe import Recipe
from robust6dof.training.recorded_clips import Clip, open_clips, split_clips
from robust6dof.training.recorded_pairs import RecordedPairs
from training.rendered_recordings import K, write_recordings

VIEW = ViewConfig(points=64, crop_px=24)


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_recordings(tmp_path_factory.mktemp("recordings"))


def _pairs(clips: list[Clip], seed: int = 0, most_gap: int = 3) -> RecordedPairs:
    return RecordedPairs(clips, VIEW, 40, seed, 100, most_gap)


def _points_cam(view) -> np.ndarray:
    return to_camera(view.points, view.T_cam_pred, view.scale)[0].double().numpy()


def _frame_of(clip: Clip, T_cam_obj: np.ndarray) -> int:
    """Which frame of a clip has this pose."""
    truths = [clip.truth(index) for index in range(len(clip.sequence))]
    return int(np.argmin([np.abs(t.T_cam_obj - T_cam_obj).max() for t in truths]))


def test_the_truth_of_a_pair_is_that_of_its_frames(root: Path) -> None:
    """Each point falls on the mask of the very frame whose pose the pair says it has."""
    clips = open_clips(root, ["mug"])[:1]
    pairs = _pairs(clips)
    for index in range(6):
        pair = pairs[index]
        for view, T, on_object in (
            (pair.previous, pair.truth.T_cam_obj_prev, pair.truth.on_object_prev),
            (pair.current, pair.truth.T_cam_obj_cur, pair.truth.on_object_cur),
        ):
            T_cam_obj = T[0].double().numpy()
            truth = clips[0].truth(_frame_of(clips[0], T_cam_obj))
            assert truth is not None
            np.testing.assert_allclose(truth.T_cam_obj, T_cam_obj, atol=1e-6)
            points = _points_cam(view)
            x, y = np.rint(project(points, K)).astype(int).T
            local = (points - T_cam_obj[:3, 3]) @ T_cam_obj[:3, :3]
            inside = np.all(np.abs(local) < truth.extents / 2 + 0.04 * truth.extents.min(), axis=1)
            np.testing.assert_array_equal(on_object[0].numpy()[inside], truth.mask[y, x][inside])
            assert not on_object[0].numpy()[~truth.mask[y, x]].any()
        assert pair.truth.scale[0] == pytest.approx(np.linalg.norm(truth.extents), rel=1e-6)


def test_a_point_far_outside_the_box_is_background_whatever_the_mask_says(root: Path) -> None:
    clip = open_clips(root, ["can"])[0]

    class Careless(Clip):
        def truth(self, index: int):
            truth = super().truth(index)
            truth.mask[:] = True
            return truth

    pair = _pairs([Careless(clip.sequence, clip.name, clip.category)])[0]
    T = pair.truth.T_cam_obj_cur[0].double().numpy()
    local = (_points_cam(pair.current) - T[:3, 3]) @ T[:3, :3] / pair.truth.scale.item()
    on_object = pair.truth.on_object_cur[0].numpy()
    assert not on_object.all()
    assert np.abs(local[on_object]).max() < 0.56


def test_the_frames_of_a_pair_are_a_random_gap_apart(root: Path) -> None:
    clip = open_clips(root, ["mug"])[0]
    pairs = _pairs([clip], most_gap=2)
    gaps = {
        _frame_of(clip, pair.truth.T_cam_obj_cur[0].numpy())
        - _frame_of(clip, pair.truth.T_cam_obj_prev[0].numpy())
        for pair in (pairs[index] for index in range(30))
    }
    assert {-2, -1, 1, 2} <= gaps <= {-2, -1, 0, 1, 2}


def test_a_pair_depends_on_seed_and_number_alone(root: Path) -> None:
    a, b = _pairs(open_clips(root))[5], _pairs(open_clips(root))[5]
    assert torch.equal(a.current.points, b.current.points)
    assert torch.equal(a.previous.T_cam_pred, b.previous.T_cam_pred)
    assert not torch.equal(a.current.points, _pairs(open_clips(root), seed=1)[5].current.points)


def test_a_frame_without_annotation_is_no_part_of_a_pair(root: Path, tmp_path: Path) -> None:
    """With poses on one frame alone, that frame is both views."""
    copy = tmp_path / "one"
    shutil.copytree(root / "can_0", copy)
    lines = (copy / "ground_truth.jsonl").read_text().splitlines(keepends=True)
    (copy / "ground_truth.jsonl").write_text(lines[0])
    pair = _pairs(open_clips(copy))[0]
    assert torch.equal(pair.truth.T_cam_obj_prev, pair.truth.T_cam_obj_cur)
    assert not torch.equal(pair.previous.T_cam_pred, pair.current.T_cam_pred)


def test_sequences_held_out_are_never_trained_on(root: Path) -> None:
    network = preset("tiny")
    clips = open_clips(root)
    pairs, held_out = make_recorded_sets(network, 0, 4, 8, 4, clips)
    assert isinstance(pairs.pairs, RecordedPairs)
    assert held_out is not None
    learned, kept = (
        {clip.sequence.name for of_one in made.clips.values() for clip in of_one}
        for made in (pairs.pairs, held_out)
    )
    assert learned.isdisjoint(kept)
    assert learned | kept == {"mug_0", "mug_1", "can_0", "can_1"}
    assert {name.split("_")[0] for name in kept} == {"mug", "can"}
    for pair in (pairs[0], held_out[0]):
        assert pair.current.points.shape[1] == network.points
        assert pair.prior.shape[1] == network.prior_points


@pytest.mark.parametrize("seed", range(5))
def test_a_split_leaves_every_category_something_to_learn_from(root: Path, seed: int) -> None:
    """One category is in a single sequence; others share sequences."""
    sequence = open_clips(root)[0].sequence
    shows = {f"s{i}": {("mug", "can", "bowl")[i % 3]} for i in range(15)} | {"both": {"mug", "can"}}
    shows["lone"] = {"laptop"}

    def named(name: str):
        fields = vars(sequence) | {"name": name}
        return type(sequence)(**fields)

    clips = [Clip(named(name), c, c) for name, of_one in shows.items() for c in of_one]
    learned, kept = split_clips(clips, seed)
    assert len(learned) + len(kept) == len(clips)
    assert {c.sequence.name for c in learned}.isdisjoint({c.sequence.name for c in kept})
    assert {c.category for c in learned} == {"mug", "can", "bowl", "laptop"}
    assert {c.category for c in kept} == {"mug", "can", "bowl"}
    assert 3 <= len({c.sequence.name for c in kept}) <= 6


def test_one_recording_alone_cannot_be_validated_on(root: Path) -> None:
    clips = open_clips(root / "mug_0")
    with pytest.raises(InputError, match="--held-out 0"):
        make_recorded_sets(preset("tiny"), 0, 4, 8, 4, clips)
    pairs, held_out = make_recorded_sets(preset("tiny"), 0, 4, 8, 0, clips)
    assert held_out is None
    assert len(pairs) == 8


def test_what_cannot_be_learned_from_is_refused_with_its_reason(root: Path, tmp_path: Path) -> None:
    def broken(name: str) -> Path:
        return Path(shutil.copytree(root / "mug_0", tmp_path / name))

    no_poses = broken("no_poses")
    (no_poses / "ground_truth.jsonl").unlink()
    shutil.rmtree(no_poses / "annotated_poses")
    with pytest.raises(DataError, match=r"no_poses.*no object poses.*annotated_poses"):
        open_clips(no_poses)
    no_masks = broken("no_masks")
    shutil.rmtree(no_masks / "masks")
    with pytest.raises(DataError, match=r"no masks of mug_0.*masks/"):
        open_clips(no_masks)
    unknown = broken("unknown")
    (unknown / "ground_truth.jsonl").unlink()
    with pytest.raises(DataError, match=r"category.*not said.*ground_truth.jsonl"):
        open_clips(unknown)
    teapot = broken("teapot")
    text = (teapot / "ground_truth.jsonl").read_text()
    (teapot / "ground_truth.jsonl").write_text(text.replace('"mug"', '"teapot"'))
    with pytest.raises(DataError, match=r"teapot.*no prior.*robust6dof priors"):
        open_clips(teapot)
    sizeless = broken("sizeless")
    rows = [json.loads(line) | {"extents_m": None} for line in text.splitlines()]
    (sizeless / "ground_truth.jsonl").write_text("".join(json.dumps(r) + "\n" for r in rows))
    with pytest.raises(DataError, match=r"size of mug_0.*extents_m"):
        open_clips(sizeless)
    with pytest.raises(DataError, match="none of: bowl"):
        open_clips(root, ["bowl"])


def test_what_is_sound_is_kept_beside_what_is_not(root: Path, tmp_path: Path) -> None:
    shutil.copytree(root / "mug_0", tmp_path / "good")
    shutil.copytree(root / "mug_1", tmp_path / "bad")
    shutil.rmtree(tmp_path / "bad" / "masks")
    with pytest.warns(Robust6dofWarning, match="1 left out; bad: there are no masks"):
        clips = open_clips(tmp_path)
    assert [clip.sequence.name for clip in clips] == ["good"]


def test_benchmark_recordings_are_remarked_upon(root: Path, tmp_path: Path) -> None:
    shutil.copytree(root / "mug_0", tmp_path / "mug_0")
    (tmp_path / "mug_0" / "plan.json").write_text(json.dumps({"seed": 2_000_003}))
    with pytest.warns(Robust6dofWarning, match="benchmark AerialPose-Sim"):
        open_clips(tmp_path)


def _facing_box(instance_id: int, class_id: int, model: str, x: float) -> Instance:
    """A box whose front is where the image shows it."""
    T_cam_obj = make_transform(np.diag([1.0, -1.0, -1.0]), np.array([x, 0.0, 0.8]))
    (left, top), (right, bottom) = project(
        np.array([[x - 0.05, -0.05, 0.8], [x + 0.05, 0.05, 0.8]]), K_REAL
    ).astype(int)
    rows, columns = slice(top, bottom), slice(left, right)
    return Instance(instance_id, class_id, model, T_cam_obj, np.full(3, 0.1), rows, columns)


def _write_nocs(root: Path, folder: str) -> list[Instance]:
    instances = [_facing_box(1, 6, "mug_a_norm", -0.1), _facing_box(2, 2, "bowl_a_norm", 0.1)]
    for name in ("0000", "0001"):
        write_frame(root / folder / "scene_1", name, instances)
        depth = np.full((480, 640), 800, np.uint16)
        write_image(root / folder / "scene_1" / f"{name}_depth.png", depth)
        label = {
            "instance_ids": [one.instance_id for one in instances],
            "rotations": np.stack([one.T_cam_obj[:3, :3] for one in instances]),
            "translations": np.stack([one.T_cam_obj[:3, 3] for one in instances]),
            "scales": np.array([one.scale for one in instances]),
            "size": np.stack([one.extents / one.scale for one in instances]),
            "handle_visibility": np.array([0, 1]),
        }
        write_pickle(root / folder / "scene_1" / f"{name}_label.pkl", label)
    return instances


@pytest.mark.parametrize("folder", ["real_train", "Real/train"])
def test_nocs_is_learned_from(tmp_path: Path, folder: str) -> None:
    mug, bowl = _write_nocs(tmp_path, folder)
    pairs = _pairs(open_clips(tmp_path))
    assert pairs.categories == ("bowl", "mug")
    for index, instance in ((0, bowl), (1, mug)):
        truth = pairs[index].truth
        np.testing.assert_allclose(truth.T_cam_obj_cur[0], instance.T_cam_obj, atol=1e-6)
        assert truth.scale.item() == pytest.approx(instance.scale, rel=1e-5)
        assert truth.symmetric.item(), "a bowl; a mug that hides its handle"


@pytest.mark.parametrize("folder", ["real_test", "Real/test", "val"])
def test_the_test_split_of_nocs_is_not(tmp_path: Path, folder: str) -> None:
    _write_nocs(tmp_path, folder)
    with pytest.raises(DataError, match="no training split of NOCS"):
        open_clips(tmp_path)
    with pytest.raises(DataError, match="no training split of NOCS"):
        open_clips(tmp_path / folder / "scene_1")


def _write_ycb(folder: Path, name: str, R: np.ndarray) -> None:
    folder.mkdir(parents=True)
    for frame in ("000001", "000002"):
        label = np.zeros((480, 640), np.uint8)
        label[180:300, 250:370] = YCB_OBJECTS.index(name) + 1
        write_image(folder / f"{frame}-color.png", np.full((480, 640, 3), 90, np.uint8))
        write_image(folder / f"{frame}-depth.png", np.full((480, 640), 8000, np.uint16))
        write_image(folder / f"{frame}-label.png", label)
        meta = {
            "cls_indexes": np.array([[YCB_OBJECTS.index(name) + 1]], np.uint8),
            "poses": np.c_[R, [0.0, 0.0, 0.8]],
            "factor_depth": np.uint16(10000),
            "intrinsic_matrix": K_FIRST,
        }
        scipy.io.savemat(folder / f"{frame}-meta.mat", meta)


def test_videos_of_ycb_video_are_learned_from_in_this_packages_axes(tmp_path: Path) -> None:
    name = "006_mustard_bottle"
    R = R_YCBV_OBJ @ np.diag([-1.0, 1.0, -1.0])
    _write_ycb(tmp_path / "data" / "0001", name, R)
    _write_ycb(tmp_path / "data" / "0048", "025_mug", R)
    pairs = _pairs(open_clips(tmp_path))
    assert pairs.categories == (name,), "0048 is a test video"
    truth = pairs[0].truth
    np.testing.assert_allclose(truth.T_cam_obj_cur[0, :3, :3], R @ R_YCBV_OBJ, atol=1e-6)
    assert truth.scale.item() == pytest.approx(np.linalg.norm(YCB_SIDES_M[name]), rel=1e-5)
    shutil.rmtree(tmp_path / "data" / "0001")
    with pytest.raises(DataError, match="only test videos"):
        open_clips(tmp_path)


@pytest.mark.slow
def test_the_network_learns_from_recordings(tmp_path: Path) -> None:
    root = write_recordings(tmp_path / "data", ("mug", "can", "bowl"))
    network = preset("tiny")
    pairs, held_out = make_recorded_sets(network, 0, 48, 150 * 8, 8, open_clips(root))
    recipe = Recipe(learning_rate=2e-3, batch=8, steps=150, clip=1.0)
    config = TrainConfig(network, recipe, log_every=1, validate_every=150)
    train(config, pairs, held_out, tmp_path / "run")
    rows = [json.loads(line) for line in (tmp_path / "run" / "log.jsonl").read_text().splitlines()]
    losses = [row["loss"] for row in rows if "loss" in row]
    assert np.mean(losses[-20:]) < np.mean(losses[:20]) - 0.8
    assert "validation/anchor_5deg5cm" in rows[-1]
