"""The whole network: invariances, robustness, sizes."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from network.scenes import random_prior, random_rotations, random_view
from robust6dof.errors import InputError
from robust6dof.geometry.alignment import fit_rigid
from robust6dof.network.config import PRESETS, NetworkConfig, preset
from robust6dof.network.inputs import ViewBatch, ViewFeatures, to_camera
from robust6dof.network.robust6dof_net import Robust6DofNet
from robust6dof.solver.absolute import fit_absolute

CONFIG = preset("tiny")


def make_net(config=CONFIG, seed=0):
    torch.manual_seed(seed)
    return Robust6DofNet(config).eval()


def assert_same(a: ViewFeatures, b: ViewFeatures, atol=2e-5):
    for name in vars(a):
        torch.testing.assert_close(getattr(a, name), getattr(b, name), atol=atol, rtol=1e-4)


@torch.no_grad()
def test_forward_equals_encoding_one_frame_after_the_other():
    net, first, second = make_net(), random_view(CONFIG, seed=1), random_view(CONFIG, seed=2)
    output = net(first, second, random_prior(CONFIG))
    prior = net.encode_prior(random_prior(CONFIG))
    previous = net.encode(first, prior)
    current = net.encode(second, prior, previous)
    assert_same(output.previous, previous)
    assert_same(output.current, current)
    torch.testing.assert_close(
        output.matches.log_probability, net.match(previous, current).log_probability
    )


@torch.no_grad()
def test_batch_of_one_equals_batch_of_many():
    net, view, prior = make_net(), random_view(CONFIG, 3), random_prior(CONFIG, 3)
    whole = net.encode(view, net.encode_prior(prior))
    for b in range(3):
        one = slice(b, b + 1)
        assert_same(net.encode(view[one], net.encode_prior(prior[one])), whole[one])


@torch.no_grad()
def test_the_order_of_points_does_not_matter():
    net, view, prior = make_net(), random_view(CONFIG), random_prior(CONFIG)
    order = torch.randperm(CONFIG.points, generator=torch.Generator().manual_seed(1))
    shuffled = ViewBatch(
        view.points[:, order], view.rgb, view.pixels[:, order], view.T_cam_pred, view.scale
    )
    a = net.encode(view, net.encode_prior(prior))
    b = net.encode(shuffled, net.encode_prior(prior))
    torch.testing.assert_close(a.keypoints, b.keypoints, atol=2e-5, rtol=1e-4)
    torch.testing.assert_close(a.canonical[:, order], b.canonical, atol=2e-5, rtol=1e-4)
    torch.testing.assert_close(a.assignment[:, :, order], b.assignment, atol=2e-5, rtol=1e-4)
    torch.testing.assert_close(a.keypoint_features, b.keypoint_features, atol=2e-4, rtol=1e-3)


@torch.no_grad()
def test_moving_the_whole_scene_moves_the_answer_with_it():
    net, view = make_net(), random_view(CONFIG)
    prior = net.encode_prior(random_prior(CONFIG))
    R = random_rotations(1, torch.Generator().manual_seed(3))[0]
    t = torch.tensor([0.3, -0.2, 0.5])
    T_moved = view.T_cam_pred.clone()
    T_moved[:, :3, :3] = R @ view.T_cam_pred[:, :3, :3]
    T_moved[:, :3, 3] = view.T_cam_pred[:, :3, 3] @ R.T + t
    moved = ViewBatch(view.points, view.rgb, view.pixels, T_moved, view.scale)
    a, b = net.encode(view, prior), net.encode(moved, prior)
    torch.testing.assert_close(b.keypoints_cam, a.keypoints_cam @ R.T + t, atol=1e-5, rtol=1e-4)
    torch.testing.assert_close(b.canonical, a.canonical)


@torch.no_grad()
def test_a_moved_scene_moves_the_solved_poses():
    """From points in the camera to the solvers' answers; the prediction moves along."""
    net, prior = make_net(), random_prior(CONFIG, 1)
    views = [random_view(CONFIG, 1, seed) for seed in (1, 2)]
    clouds = [to_camera(v.points, v.T_cam_pred, v.scale) for v in views]
    G = torch.eye(4)
    G[:3, :3] = random_rotations(1, torch.Generator().manual_seed(3))[0]
    G[:3, 3] = torch.tensor([0.3, -0.2, 0.5])

    def solve(motion):
        seen = []
        for view, cloud in zip(views, clouds, strict=True):
            T = motion @ view.T_cam_pred
            cam = cloud @ motion[:3, :3].T + motion[:3, 3]
            points = (cam - T[:, None, :3, 3]) @ T[:, :3, :3] / view.scale[:, None, None]
            seen.append(replace(view, points=points, T_cam_pred=T))
        output = net(*seen, prior)
        k_prev, k_cur = (f.keypoints_cam[0].numpy() for f in (output.previous, output.current))
        pairs = fit_rigid(k_prev.astype(float), k_cur.astype(float))
        now = output.current
        cam = to_camera(now.points, now.T_cam_pred, now.scale)[0].numpy()
        anchor = fit_absolute(
            now.canonical[0].numpy(), cam, now.point_weight[0].numpy(), np.random.default_rng(0)
        )
        return pairs, anchor

    (T_cur_prev, here), (moved, there) = solve(torch.eye(4)), solve(G)
    G = G.double().numpy()
    np.testing.assert_allclose(moved, G @ T_cur_prev @ np.linalg.inv(G), atol=2e-4)
    np.testing.assert_allclose(there.T_cam_obj, G @ here.T_cam_obj, atol=2e-4)
    assert there.scale == pytest.approx(here.scale, rel=1e-4)


@torch.no_grad()
def test_the_order_of_the_priors_points_does_not_matter():
    net, view, prior = make_net(), random_view(CONFIG), random_prior(CONFIG)
    order = torch.randperm(CONFIG.prior_points, generator=torch.Generator().manual_seed(1))
    a = net.encode(view, net.encode_prior(prior))
    b = net.encode(view, net.encode_prior(prior[:, order]))
    assert_same(a, b)


@torch.no_grad()
def test_keypoints_are_convex_combinations_of_the_points():
    net, view = make_net(), random_view(CONFIG)
    features = net.encode(view, net.encode_prior(random_prior(CONFIG)))
    assert (features.assignment >= 0).all()
    torch.testing.assert_close(features.assignment @ view.points, features.keypoints)
    cam = view.scale[:, None, None] * view.points @ view.T_cam_pred[:, :3, :3].mT
    cam = cam + view.T_cam_pred[:, None, :3, 3]
    torch.testing.assert_close(features.assignment @ cam, features.keypoints_cam)


def degenerate_points(kind: str) -> torch.Tensor:
    points = random_view(CONFIG).points.clone()
    if kind == "duplicates":
        points[:, 1:] = points[:, :1]
    elif kind == "plane":
        points[..., 2] = 0.1
    elif kind == "far away":  # a background that shares nothing with the other view
        points += 40.0
    return points


@pytest.mark.parametrize(
    "setting",
    [{}, {"shape_filter": "max", "similarity": "printed"}, {"keypoint_source": "unsupervised"}],
    ids=str,
)
@pytest.mark.parametrize("kind", ["duplicates", "plane", "far away"])
def test_no_nan_from_degenerate_views(kind, setting):
    net, view = make_net(replace(CONFIG, **setting)).train(), random_view(CONFIG)
    odd = ViewBatch(degenerate_points(kind), view.rgb, view.pixels, view.T_cam_pred, view.scale)
    output = net(view, odd, random_prior(CONFIG))
    for value in vars(output.current).values():
        assert torch.isfinite(value).all()
    total = output.current.keypoints.sum() + output.matches.log_probability.sum()
    total.backward()
    for parameter in net.parameters():
        assert parameter.grad is None or torch.isfinite(parameter.grad).all()


@torch.no_grad()
def test_other_numbers_of_points_and_keypoints_need_no_new_weights():
    net = make_net()
    other = replace(CONFIG, points=30, prior_points=25, keypoints=9)
    larger = Robust6DofNet(other).eval()
    larger.load_state_dict(net.state_dict())
    features = larger.encode(random_view(other), larger.encode_prior(random_prior(other)))
    assert features.keypoints.shape == (2, 9, 3)


def test_parameter_counts():
    counts = {
        name: sum(p.numel() for p in Robust6DofNet(config).parameters())
        for name, config in PRESETS.items()
    }
    assert counts["paper"] <= 6.0e6
    assert counts["tiny"] < counts["small"] < counts["paper"]
    assert (preset("paper").points, preset("paper").prior_points) == (2048, 2048)
    assert preset("paper").keypoints == 512
    assert preset("paper").match_threshold == 0.45


def test_configuration_goes_through_json_and_names_what_is_wrong():
    for config in PRESETS.values():
        assert NetworkConfig.from_json(config.to_json()) == config
    with pytest.raises(InputError, match="unknown network settings"):
        NetworkConfig.from_json('{"depth": 3}')
    with pytest.raises(InputError, match="not JSON"):
        NetworkConfig.from_json("{")
    with pytest.raises(InputError, match="multiple of heads"):
        NetworkConfig(width=10, heads=3)
    with pytest.raises(InputError, match="no preset"):
        preset("huge")
