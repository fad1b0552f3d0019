"""Several objects at once are tracked as each alone would be, with fewer calls of the network."""

from __future__ import annotations

from unittest.mock import patch

import numpy as np
import pytest
import torch

from baselines.tabletop_scene import look_at_object, make_tabletop
from robust6dof.errors import InputError
from robust6dof.network.config import preset
from robust6dof.network.robust6dof_net import Robust6DofNet
from robust6dof.shapes.priors import load_prior
from robust6dof.tracking.encoder import ViewEncoder
from robust6dof.tracking.several import SeveralTrackers
from robust6dof.tracking.tracker import Tracker
from robust6dof.tracking.tracker_config import TrackerConfig

SCENE = make_tabletop("mug", 0)
SHOTS = [
    SCENE.shoot(look_at_object(0.7 + 0.02 * i, 0.7, 0.7), np.random.default_rng(i), stamp=i / 30)
    for i in range(4)
]


def network(seed: int) -> Robust6DofNet:
    torch.manual_seed(seed)
    return Robust6DofNet(preset("tiny"))


def tracker(net: Robust6DofNet, seed: int) -> Tracker:
    encoder = ViewEncoder(net, load_prior("mug"), "mug", seed)
    return Tracker(encoder, TrackerConfig(look_every=1))


def test_each_object_is_tracked_as_it_would_be_alone() -> None:
    one, other = network(0), network(1)
    trackers = [tracker(one, 0), tracker(other, 1), tracker(one, 2)]
    first, *later = SHOTS
    alone = together = tuple(
        each.start(first.frame, T_cam_obj=first.T_cam_obj, extents=SCENE.model.extents)
        for each in trackers
    )
    several = SeveralTrackers(trackers)
    for shot in later:
        alone = tuple(each.step(t, shot.frame) for each, t in zip(trackers, alone, strict=True))
        with patch.object(one, "encode", wraps=one.encode) as encode:
            together = several.step(together, shot.frame)
        assert encode.call_args_list[0].args[0].points.shape[0] == 2, "both in one call"
        for a, b in zip(alone, together, strict=True):
            np.testing.assert_allclose(a.T_cam_obj, b.T_cam_obj, atol=1e-5)
            assert a.confidence == pytest.approx(b.confidence, abs=1e-4)
            assert a.state is b.state


def test_a_track_for_each_tracker_is_asked_for() -> None:
    with pytest.raises(InputError, match="0 tracks for 1 trackers"):
        SeveralTrackers([tracker(network(0), 0)]).step([], SHOTS[0].frame)
