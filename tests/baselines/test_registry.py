"""Trackers by name, and the one that is given the object's mesh."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from baselines.tabletop_scene import look_at_object, make_tabletop
from robust6dof.baselines.registry import TRACKERS, make_tracker
from robust6dof.errors import DataError, InputError
from robust6dof.frames import PoseTracker
from robust6dof.geometry.transforms import make_transform, rotation_error
from robust6dof.network.checkpoint import save_network
from robust6dof.network.config import ablation, preset
from robust6dof.network.robust6dof_net import Robust6DofNet


@pytest.mark.parametrize("name", ["icp", "features", "static"])
def test_trackers_without_weights_are_pose_trackers(name):
    assert isinstance(make_tracker(name, "mug"), PoseTracker)


def test_unknown_names_and_missing_ingredients_are_refused(tmp_path):
    with pytest.raises(InputError, match="no tracker 'magic'; there is: robust6dof"):
        make_tracker("magic", "mug")
    with pytest.raises(InputError, match="CAD mesh"):
        make_tracker("oracle-icp", "mug")
    with pytest.raises(InputError, match="weights of its own"):
        make_tracker("unsupervised-keypoints", "mug")
    for name in ("robust6dof", "keypoints"):
        with pytest.raises(DataError, match="no configuration beside the weights"):
            make_tracker(name, "mug", weights=tmp_path / "none.safetensors", device="cpu")


def test_unsupervised_keypoints_takes_no_other_network(tmp_path):
    tiny = preset("tiny")
    plain = save_network(Robust6DofNet(tiny), tmp_path / "plain")
    with pytest.raises(InputError, match="of the kind 'prior'"):
        make_tracker("unsupervised-keypoints", "mug", weights=plain, device="cpu")
    config = ablation("unsupervised-keypoints", tiny)
    own = save_network(Robust6DofNet(config), tmp_path / "own")
    assert isinstance(
        make_tracker("unsupervised-keypoints", "mug", weights=own, device="cpu"), PoseTracker
    )
    assert "unsupervised-keypoints" in TRACKERS


def test_the_mesh_corrects_a_wrong_start_and_keeps_the_pose():
    scene, rng = make_tabletop("mug", 0), np.random.default_rng(0)
    tracker = make_tracker("oracle-icp", "mug", cad=lambda: scene.model.mesh)
    T_cam_world = look_at_object(0.7, 0.7, 0.6)
    shot = scene.shoot(T_cam_world, rng, 0.0)
    turn = Rotation.from_rotvec(np.radians([3.0, 4.0, -2.0])).as_matrix()
    T_wrong = make_transform(
        turn @ shot.T_cam_obj[:3, :3], shot.T_cam_obj[:3, 3] + [0.01, -0.01, 0.012]
    )
    track = tracker.start(shot.frame, T_cam_obj=T_wrong, extents=1.2 * scene.model.extents)
    np.testing.assert_allclose(track.extents, scene.model.extents)
    for index in range(1, 4):
        assert np.degrees(rotation_error(track.T_cam_obj[:3, :3], shot.T_cam_obj[:3, :3])) < 2.5
        assert np.linalg.norm(track.T_cam_obj[:3, 3] - shot.T_cam_obj[:3, 3]) < 0.006
        points = len(track.memory.surface)
        shot = scene.shoot(look_at_object(0.7 + 0.02 * index, 0.7, 0.6), rng, index / 20)
        track = tracker.step(track, shot.frame)
        assert len(track.memory.surface) == points
