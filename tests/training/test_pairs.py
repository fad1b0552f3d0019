import numpy as np
import pytest
import torch

from robust6dof.errors import InputError
from robust6dof.geometry.transforms import transform_points
from robust6dof.network.config import preset
from robust6dof.network.device import resolve_device
from robust6dof.network.inputs import to_camera
from robust6dof.shapes.procedural import make_object
from robust6dof.synthetic.close_up import CloseUp
from robust6dof.tracking.view import ViewConfig
from robust6dof.training.pair_sets import make_pair_sets
from robust6dof.training.pairs import PairConfig, SyntheticPairs
from robust6dof.training.repeated_pairs import RepeatedPairs

POINTS = 64


@pytest.fixture(scope="module")
def repeated():
    pairs = SyntheticPairs(ViewConfig(points=POINTS, crop_px=24), 40, seed=3, count=4)
    return RepeatedPairs(pairs, epoch=2, points=POINTS, prior_points=40, count=8)


def _cloud(pair):
    view = pair.current
    return to_camera(view.points, view.T_cam_pred, view.scale)[0].double()


def test_another_prediction_leaves_the_points_where_they_are(repeated):
    """All the points are drawn, in another order, so that the clouds can be compared."""
    first, again = repeated[1], repeated[3]
    assert not torch.allclose(first.current.T_cam_pred, again.current.T_cam_pred, atol=1e-3)
    assert not torch.allclose(first.current.scale, again.current.scale, atol=1e-4)
    distance = torch.cdist(_cloud(first), _cloud(again))
    assert distance.amin(0).max() < 1e-5
    assert distance.amin(1).max() < 1e-5
    torch.testing.assert_close(first.truth.T_cam_obj_cur, again.truth.T_cam_obj_cur)


def test_the_drawn_prediction_stays_a_rigid_transform(repeated):
    R = repeated[3].previous.T_cam_pred[0, :3, :3].double()
    torch.testing.assert_close(R @ R.mT, torch.eye(3).double(), atol=1e-5, rtol=0)
    assert torch.linalg.det(R) > 0.999


def test_a_pair_depends_on_seed_and_index_alone(repeated):
    other = RepeatedPairs(repeated.pairs, 2, POINTS, 40, 8)
    torch.testing.assert_close(repeated[5].current.points, other[5].current.points)


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a CUDA device here")
def test_cuda_without_a_device_is_refused():
    assert resolve_device("auto") == "cpu"
    with pytest.raises(InputError, match="--device cpu"):
        resolve_device("cuda")


def test_pairs_to_train_on_and_pairs_held_out_fit_the_network_and_share_no_shape():
    network = preset("tiny")
    pairs, held_out = make_pair_sets(network, seed=5, epoch=2, count=6, held_out=3)
    assert (len(pairs), pairs.epoch, len(held_out)) == (6, 2, 3)
    assert (pairs.pairs.seed, held_out.seed) == (5, 6)
    first, last = pairs.pairs.config, held_out.config
    assert first.first_object + first.object_pool <= last.first_object
    for pair in (pairs[0], held_out[0]):
        assert pair.current.points.shape[1] == network.points
        assert pair.prior.shape[1] == network.prior_points


def test_an_object_may_lie_on_any_side_and_is_told_the_same_truth():
    """Canonical coordinates of the seen surface lie inside the object's own box, laid or not."""
    config = PairConfig(lying_share=1.0)
    pairs = SyntheticPairs(ViewConfig(points=POINTS, crop_px=24), 40, 4, 6, config, ["camera"])
    for index in range(6):
        pair = pairs[index]
        T = pair.truth.T_cam_obj_cur[0].double()
        inside = (_cloud(pair) - T[:3, 3]) @ T[:3, :3] / pair.truth.scale[0].double()
        on_object = pair.truth.on_object_cur[0]
        assert on_object.any()
        # The sides of a camera are at most 0.95 of its diagonal; the depth is noisy.
        assert inside[on_object].abs().max() < 0.55


def test_the_table_is_under_a_lying_object():
    target = make_object("bottle", 3)
    turn = np.array([[0.0, -1, 0], [1, 0, 0], [0, 0, 1]])  # the room's up is −x of the object
    scenes = (CloseUp.draw(np.random.default_rng(seed), target, turn).scene for seed in range(20))
    scene = next(scene for scene in scenes if len(scene.instances) > 1)
    table = scene.instances[1]
    corners = transform_points(table.T_world_mesh, table.mesh.vertices)
    np.testing.assert_allclose(corners[:, 0], target.extents[0] / 2, atol=1e-9)
    assert all(light.direction_world[0] > 0 for light in scene.lights)
