"""Every part is a switch, every switch tells, every row of the paper's ablations is one."""

from dataclasses import replace
from itertools import combinations
from typing import get_args, get_type_hints

import pytest
import torch

from network.scenes import random_prior, random_view
from robust6dof.errors import InputError
from robust6dof.network.config import NetworkConfig, ablation, preset
from robust6dof.network.matching import select_pairs
from robust6dof.network.robust6dof_net import Robust6DofNet

CONFIG = preset("tiny")


def make_net(config=CONFIG, seed=0):
    torch.manual_seed(seed)
    return Robust6DofNet(config).eval()


SWITCHES = [
    {"pixel_stem": "rgb"},
    {"weight_shared_attention": False},
    {"dense_fusion": "shared"},
    {"dense_fusion": "off"},
    {"contraction": "printed"},
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


# Switches that other tests of this file and of the stages turn.
ELSEWHERE = {"fine_matching", "canonical_anchor", "pose_correction"}


def test_no_switch_is_left_untried():
    """All fields but sizes: every value of a choice, both of a yes or no."""
    tried = {(name, value) for switch in SWITCHES for name, value in switch.items()}
    for name, hint in get_type_hints(NetworkConfig).items():
        values = (True, False) if hint is bool else get_args(hint) if "Literal" in str(hint) else ()
        others = {value for value in values if value != getattr(CONFIG, name)}
        assert name in ELSEWHERE or all((name, value) in tried for value in others), name


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


KEYPOINT_ROWS = ("no-prior-guidance", "unsupervised-keypoints", "no-finer-matching")


@torch.no_grad()
def test_each_row_of_the_ablations_gives_something_else():
    views, prior = (random_view(CONFIG, seed=1), random_view(CONFIG, seed=2)), random_prior(CONFIG)
    said = {}
    for name in ("M0", "M1", "M2", "M3", "M4", "M5", *KEYPOINT_ROWS):
        config = ablation(name, CONFIG)
        output = shared_weights(config)(*views, prior)
        pairs = select_pairs(
            output.previous, output.current, output.matches, 0.0, config.fine_matching
        )
        said[name] = pairs.current.mean(0)
        assert torch.isfinite(pairs.current).all()
    for a, b in combinations(said, 2):
        assert (said[a] - said[b]).abs().max() > 1e-5, (a, b)


def test_the_paper_preset_keeps_every_part_of_the_paper():
    config = preset("paper")
    assert ablation("M5", config) == config
    assert config.dense_fusion != "off"
    assert config.shape_filter != "off"
    assert config.keypoint_source == "prior"
    assert config.weight_shared_attention
    assert config.temporal_encoder
    assert config.augmentation_decoder
    assert config.fine_matching
