"""The whole network: invariances, switches, robustness, one pair learnt."""

from dataclasses import replace

import pytest
import torch

from network.scenes import random_prior, random_rotations, random_view
from robust6dof.errors import InputError
from robust6dof.network.config import PRESETS, NetworkConfig, ablation, preset
from robust6dof.network.inputs import ViewBatch, ViewFeatures
from robust6dof.network.robust6dof_net import Robust6DofNet

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
def test_keypoints_are_convex_combinations_of_the_points():
    net, view = make_net(), random_view(CONFIG)
    features = net.encode(view, net.encode_prior(random_prior(CONFIG)))
    assert (features.assignment >= 0).all()
    torch.testing.assert_close(features.assignment @ view.points, features.keypoints)
    cam = view.scale[:, None, None] * view.points @ view.T_cam_pred[:, :3, :3].mT
    cam = cam + view.T_cam_pred[:, None, :3, 3]
    torch.testing.assert_close(features.assignment @ cam, features.keypoints_cam)


SWITCHES = [
    {"pixel_stem": "rgb"},
    {"weight_shared_attention": False},
    {"dense_fusion": "shared"},
    {"dense_fusion": "off"},
    {"fusion_residual": False},
    {"similarity": "printed"},
    {"temporal_encoder": False},
    {"shape_filter": "max"},
    {"shape_filter": "off"},
    {"augmentation_decoder": False},
    {"keypoint_source": "learned"},
    {"keypoint_source": "unsupervised"},
    {"structure_bias": False},
    {"foreground": False},
    {"match_temperature": 0.2},
]


def shared_weights(config: NetworkConfig) -> Robust6DofNet:
    """A network of `config` with the default network's weights wherever they fit."""
    base, net = make_net().state_dict(), make_net(config)
    own = net.state_dict()
    fitting = {k: v for k, v in base.items() if k in own and own[k].shape == v.shape}
    net.load_state_dict({**own, **fitting})
    # Heads start at zero; without this, what leads to them could not be seen.
    for parameter in (net.point_head.out.weight, net.keypoint_head.out.weight):
        torch.nn.init.normal_(parameter, std=0.3, generator=torch.Generator().manual_seed(7))
    return net


@torch.no_grad()
@pytest.mark.parametrize("switch", SWITCHES, ids=lambda s: "-".join(map(str, *s.items())))
def test_each_switch_changes_the_output(switch):
    views = random_view(CONFIG, seed=1), random_view(CONFIG, seed=2)
    default = shared_weights(CONFIG)(*views, random_prior(CONFIG))
    switched = shared_weights(replace(CONFIG, **switch))(*views, random_prior(CONFIG))
    a, b = (
        torch.cat([o.current.keypoints.flatten(), o.matches.log_probability.flatten()])
        for o in (default, switched)
    )
    assert torch.isfinite(b).all()
    assert (a - b).abs().max() > 1e-3


@torch.no_grad()
def test_the_pose_correction_is_one_affine_change_of_all_points():
    view, prior = random_view(CONFIG), random_prior(CONFIG)
    nets = [shared_weights(replace(CONFIG, pose_correction=value)) for value in (True, False)]
    torch.nn.init.normal_(nets[0].point_head.correction.out.weight, std=0.1)
    a, b = (net.encode(view, net.encode_prior(prior)).canonical for net in nets)
    ones = torch.ones(2, CONFIG.points, 1)
    homogeneous = torch.cat([view.points, ones], -1)
    affine = torch.linalg.lstsq(homogeneous, a - b).solution
    assert (a - b).abs().max() > 1e-2
    torch.testing.assert_close(homogeneous @ affine, a - b, atol=1e-4, rtol=1e-3)


@torch.no_grad()
def test_the_anchor_switch_leaves_the_soft_place_on_the_prior():
    view, prior = random_view(CONFIG), random_prior(CONFIG)
    on, off = (shared_weights(replace(CONFIG, canonical_anchor=value)) for value in (True, False))
    with_anchor = on.encode(view, on.encode_prior(prior))
    without = off.encode(view, off.encode_prior(prior))
    torch.testing.assert_close(without.canonical, without.correspondence)
    assert (with_anchor.canonical - with_anchor.correspondence).abs().max() > 1e-3


def test_ablation_rows_are_configurations():
    rows = [ablation(name, CONFIG) for name in ("M0", "M1", "M2", "M3", "M4", "M5")]
    assert rows[5] == CONFIG
    assert len({row.to_json() for row in rows}) == 6
    parts = [
        [
            row.weight_shared_attention,
            row.dense_fusion != "off",
            row.temporal_encoder,
            row.shape_filter != "off",
            row.augmentation_decoder,
        ]
        for row in rows
    ]
    assert parts == [[i < count for i in range(5)] for count in range(6)]
    with pytest.raises(InputError, match="no ablation"):
        ablation("M6", CONFIG)


@pytest.mark.parametrize("name", ["M0", "M1", "M2", "M3", "M4", "no-prior-guidance"])
@torch.no_grad()
def test_ablation_rows_run(name):
    config = ablation(name, CONFIG)
    output = make_net(config)(
        random_view(config), random_view(config, seed=3), random_prior(config)
    )
    assert torch.isfinite(output.current.keypoints_cam).all()


def degenerate_points(kind: str) -> torch.Tensor:
    points = random_view(CONFIG).points.clone()
    if kind == "duplicates":
        points[:, 1:] = points[:, :1]
    elif kind == "plane":
        points[..., 2] = 0.1
    elif kind == "far away":  # a background that shares nothing with the other view
        points += 40.0
    return points


@pytest.mark.parametrize("kind", ["duplicates", "plane", "far away"])
def test_no_nan_from_degenerate_views(kind):
    net, view = make_net().train(), random_view(CONFIG)
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
