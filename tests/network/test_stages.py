"""Stages 2 and 3 against the paper's equations, written with loops."""

import math
from dataclasses import replace

import pytest
import torch

from network.scenes import random_prior, random_view
from robust6dof.network.augmentation import Augmentation, PriorEncoder, ShapeFilter, TemporalEncoder
from robust6dof.network.config import preset
from robust6dof.network.fusion import sample_pixels
from robust6dof.network.inputs import farthest_points
from robust6dof.network.keypoints import (
    AssignmentHead,
    TriPlane,
    UnsupervisedKeypoints,
    nearest_reference,
)
from robust6dof.network.matching import dual_softmax, mutual_matches, score_matrix, select_pairs
from robust6dof.network.nearest_numba import nearest_in_plane
from robust6dof.network.robust6dof_net import Robust6DofNet

CONFIG = replace(preset("tiny"), points=6, prior_points=7, keypoints=4, width=8, rank=3)
torch.manual_seed(0)


def features(n, seed):
    return torch.randn(2, n, CONFIG.width, generator=torch.Generator().manual_seed(seed))


@torch.no_grad()
@pytest.mark.parametrize("reading", ["scaled", "printed"])
def test_temporal_encoder(reading):
    layer = TemporalEncoder(replace(CONFIG, similarity=reading))
    f_obj, f_prev = features(6, 1), features(5, 2)
    f_dot = layer.norm(f_obj + layer.attention(f_obj, f_obj))
    scale = CONFIG.width**-0.5 if reading == "scaled" else 1.0
    weight = torch.cat([layer.from_previous.weight, layer.from_current.weight], 1)
    filtered = torch.empty_like(f_obj)
    for b in range(2):
        for i in range(6):
            scores = torch.stack([scale * f_dot[b, i] @ f_prev[b, j] for j in range(5)])
            share = scores.softmax(0)
            pooled = [weight @ torch.cat([share[j] * f_prev[b, j], f_obj[b, i]]) for j in range(5)]
            filtered[b, i] = torch.stack(pooled).amax(0) + layer.from_current.bias
    expected = layer.cross_norm(filtered + layer.cross_attention(f_dot, filtered))
    torch.testing.assert_close(layer(f_obj, f_prev), expected)


@torch.no_grad()
@pytest.mark.parametrize("reading", ["max", "weighted-sum"])
def test_shape_filter(reading):
    config = replace(CONFIG, shape_filter=reading)
    layer, prior = ShapeFilter(config), PriorEncoder(config)(random_prior(config))
    f_obj = features(6, 3)
    similarity = (config.width**-0.5 * f_obj @ prior.features.mT).softmax(-1)
    weight = torch.cat([layer.from_feature.weight, layer.from_coordinate.weight], 1)
    expected = torch.empty_like(f_obj)
    for b in range(2):
        for i in range(6):
            share = similarity[b, i]
            if reading == "max":
                rows = [
                    weight @ torch.cat([share[j] * prior.features[b, j], prior.points[b, j]])
                    for j in range(7)
                ]
                expected[b, i] = torch.stack(rows).amax(0) + layer.from_coordinate.bias
            else:
                rows = [
                    share[j] * torch.cat([prior.features[b, j], prior.points[b, j]])
                    for j in range(7)
                ]
                expected[b, i] = weight @ torch.stack(rows).sum(0) + layer.from_coordinate.bias
    filtered, place = layer(f_obj, prior)
    torch.testing.assert_close(filtered, expected)
    torch.testing.assert_close(place, similarity @ prior.points)


@torch.no_grad()
def test_switches_of_the_augmentation():
    prior = PriorEncoder(CONFIG)(random_prior(CONFIG))
    f_obj, f_prev = features(6, 1), features(6, 2)
    no_ste = Augmentation(replace(CONFIG, temporal_encoder=False))
    assert no_ste(f_obj, f_prev, prior)[0] is f_obj  # F_temp = F_obj
    no_ad = Augmentation(replace(CONFIG, augmentation_decoder=False))
    similarity = (CONFIG.width**-0.5 * f_obj @ prior.features.mT).softmax(-1)
    assert no_ad.shape is not None
    torch.testing.assert_close(no_ad(f_obj, f_prev, prior)[1], no_ad.shape(f_obj, prior)[0])
    neither = Augmentation(replace(CONFIG, augmentation_decoder=False, shape_filter="off"))
    f_temp, f_aug, place = neither(f_obj, f_prev, prior)
    assert f_aug is f_temp
    torch.testing.assert_close(place, similarity @ prior.points)  # computed in any case


@torch.no_grad()
def test_assignment_rows_sum_to_one_and_avoid_the_background():
    head, prior = AssignmentHead(CONFIG), PriorEncoder(CONFIG)(random_prior(CONFIG))
    f = [features(6, seed) for seed in (1, 2, 3)]
    foreground = torch.full((2, 6), 3.0)
    foreground[:, 0] = -30.0
    M = head(*f, torch.zeros(2, 6, 3), foreground, prior)
    assert M.shape == (2, CONFIG.keypoints, 6)
    torch.testing.assert_close(M.sum(-1), torch.ones(2, CONFIG.keypoints))
    assert (M[:, :, 0] < 1e-8).all()


@torch.no_grad()
def test_structure_bias_prefers_points_near_the_keypoints_place_on_the_prior():
    head, prior = AssignmentHead(CONFIG), PriorEncoder(CONFIG)(random_prior(CONFIG))
    head.query.weight.zero_()
    head.query.bias.zero_()
    head.log_beta.fill_(math.log(1e5))
    canonical = prior.anchors.repeat(1, 2, 1)[:, :6]  # point i lies where keypoint i mod 4 belongs
    f = [features(6, seed) for seed in (1, 2, 3)]
    M = head(*f, canonical, torch.zeros(2, 6), prior)
    for k in range(4):
        wanted = [i for i in range(6) if i % 4 == k]
        torch.testing.assert_close(M[:, k, wanted].sum(-1), torch.ones(2))


@torch.no_grad()
def test_triplane_reads_the_nearest_point_in_each_plane():
    layer = TriPlane(CONFIG)
    points, keypoints = torch.rand(2, 6, 3), torch.rand(2, 4, 3)
    embeddings = torch.randn(2, 6, 3 * CONFIG.width)
    got = layer(keypoints, points, embeddings)
    planes = layer.planes(embeddings).chunk(3, -1)
    for b in range(2):
        for k in range(4):
            found = []
            for plane, axes in zip(planes, ([0, 1], [1, 2], [0, 2]), strict=True):
                gaps = [float((keypoints[b, k] - p)[axes].square().sum()) for p in points[b]]
                found.append(plane[b, gaps.index(min(gaps))])
            row = torch.cat(found)
            torch.testing.assert_close(got[b, k], row / row.norm())


@torch.no_grad()
@pytest.mark.parametrize("search", [nearest_in_plane, nearest_reference])
@pytest.mark.parametrize(("keypoints", "points"), [(1, 1), (5, 63), (7, 64), (9, 300)])
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_each_search_finds_the_nearest_point(search, keypoints, points, dtype):
    k, p = torch.randn(2, keypoints, 2, dtype=dtype), torch.randn(2, points, 2, dtype=dtype)
    distance = (k[:, :, None] - p[:, None]).norm(dim=-1)
    found = distance.gather(2, search(k, p)[..., None])[..., 0]
    torch.testing.assert_close(found, distance.amin(-1))


@torch.no_grad()
def test_unsupervised_keypoints_are_regressed_from_the_pooled_feature():
    layer = UnsupervisedKeypoints(CONFIG)
    points = torch.rand(2, 6, 3)
    keypoints, M = layer(features(6, 1), points)
    assert keypoints.shape == (2, 4, 3)
    torch.testing.assert_close(M.sum(-1), torch.ones(2, 4))
    assert torch.equal(M.argmax(-1), torch.cdist(keypoints, points).argmin(-1))


def test_dual_softmax_and_mutual_nearest_neighbours():
    a, b = torch.randn(1, 4, 6), torch.randn(1, 5, 6)
    scores = score_matrix(a, b, 0.1)
    P = dual_softmax(scores).exp()
    for i in range(4):
        for j in range(5):
            s = [[float(a[0, m] @ b[0, n]) / 0.1 for n in range(5)] for m in range(4)]
            top = max(map(max, s))
            e = [[math.exp(v - top) for v in row] for row in s]
            expected = e[i][j] / sum(e[i]) * e[i][j] / sum(row[j] for row in e)
            assert float(P[0, i, j]) == pytest.approx(expected, rel=1e-4, abs=1e-7)
    chosen = mutual_matches(P, 0.2)
    for i in range(4):
        for j in range(5):
            best = P[0, i, j] == P[0, i].max() and P[0, i, j] == P[0, :, j].max()
            assert bool(chosen[0, i, j]) == bool(best and P[0, i, j] >= 0.2)


@torch.no_grad()
def test_coarse_pairs_stand_in_when_few_fine_ones_survive():
    config = preset("tiny")
    net = Robust6DofNet(config).eval()
    prior = net.encode_prior(random_prior(config, 1))
    view = net.encode(random_view(config, 1), prior)
    matches = net.match(view, view)
    coarse = select_pairs(view, view, matches, threshold=1.1)
    assert not coarse.is_fine
    assert len(coarse.previous) == config.keypoints
    torch.testing.assert_close(coarse.previous, coarse.current)
    fine = select_pairs(view, view, matches, threshold=0.0)
    assert fine.is_fine
    assert (fine.weight > 0).all()
    torch.testing.assert_close(fine.previous, fine.current)
    assert not select_pairs(view, view, matches, threshold=0.0, fine=False).is_fine


@torch.no_grad()
def test_pixels_are_looked_up_at_their_centres():
    image = torch.arange(25.0).reshape(1, 1, 5, 5)
    pixels = torch.tensor([[[0.0, 0.0], [4.0, 2.0], [1.5, 3.0]]])
    assert sample_pixels(image, pixels, 5)[0, :, 0].tolist() == pytest.approx([0.0, 14.0, 16.5])


def test_farthest_points_spread():
    line = torch.linspace(0, 1, 11)[None, :, None].repeat(1, 1, 3)
    assert sorted(farthest_points(line, 3)[0].tolist()) == [0, 5, 10]
