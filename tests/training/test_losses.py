"""Each loss against its formula, and the free turn of symmetric objects."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from network.scenes import random_prior
from robust6dof.errors import InputError
from robust6dof.geometry.alignment import fit_rigid, fit_similarity
from robust6dof.geometry.transforms import rotation_error
from robust6dof.network.matching import dual_softmax
from robust6dof.network.robust6dof_net import Robust6DofNet
from robust6dof.training.losses import (
    LOSS_SETS,
    LossConfig,
    expected_error_loss,
    matching_loss,
    pair_losses,
    rotation_loss,
)
from robust6dof.training.targets import make_targets
from training.view_pairs import CONFIG, about_y, make_pair, perfect_output

MOTION = ("rotation", "translation", "consistency", "matching", "anchor", "anchor_fit")


@torch.no_grad()
@pytest.mark.parametrize("reading", ["exact", "solved"])
def test_a_perfect_answer_costs_nothing(reading):
    views, truth, cloud = make_pair()
    _, parts = pair_losses(
        perfect_output(views, truth, cloud), truth, LossConfig(translation=reading)
    )
    for name in MOTION:
        assert parts[name] < 2e-3, name


@torch.no_grad()
def test_the_printed_translation_loss_is_wrong_by_the_rotation_about_the_keypoints_centre():
    """Its residue is (ΔR − I) times the centroid: zero only for centred keypoints."""
    views, truth, cloud = make_pair(degrees=30.0)
    output = perfect_output(views, truth, cloud)
    _, parts = pair_losses(output, truth, LossConfig(translation="printed"))
    targets = make_targets(output, truth)
    centroid = targets.to_loss_axes(output.previous.keypoints_cam).mean(1)
    turned = (targets.R_cur_prev @ centroid[..., None])[..., 0] - centroid
    assert float(parts["translation"]) == pytest.approx(float(turned.norm(dim=-1).mean()), rel=1e-3)
    assert parts["translation"] > 0.02


@torch.no_grad()
def test_losses_against_loops():
    views, truth, _ = make_pair(seed=3)
    torch.manual_seed(1)
    output = Robust6DofNet(CONFIG)(*views, random_prior(CONFIG))
    config = LossConfig(translation="exact", auxiliary_in_view=False)
    _, parts = pair_losses(output, truth, config)
    targets = make_targets(output, truth, config.match_radius)
    mvc, tra = [], []
    for b in range(2):
        s, c = float(truth.scale[b]), truth.T_cam_obj_prev[b, :3, 3]
        T = truth.T_cam_obj_cur[b] @ torch.linalg.inv(truth.T_cam_obj_prev[b])
        gaps = []
        for i in range(CONFIG.keypoints):
            moved = T[:3, :3] @ output.previous.keypoints_cam[b, i] + T[:3, 3]
            gaps.append((output.current.keypoints_cam[b, i] - moved) / s)
            for j in range(CONFIG.keypoints):
                gap = (output.current.keypoints_cam[b] - moved).norm(dim=-1) / s
                assert not targets.matches[b, i, j] or (
                    int(gap.argmin()) == j and float(gap[j]) <= config.match_radius
                )
        mvc.append(sum(float(g.norm()) for g in gaps) / len(gaps))
        tra.append(float((sum(gaps) / len(gaps)).norm()))
        # The losses' axes: x' = (x − c) / s.
        x = torch.tensor([0.1, 0.2, 0.9])
        moved = ((T[:3, :3] @ x + T[:3, 3]) - c) / s
        torch.testing.assert_close(
            targets.R_cur_prev[b] @ ((x - c) / s) + targets.t_cur_prev[b],
            moved,
            atol=1e-4,
            rtol=1e-4,
        )
    assert float(parts["consistency"]) == pytest.approx(sum(mvc) / 2, rel=1e-4)
    assert float(parts["translation"]) == pytest.approx(sum(tra) / 2, rel=1e-4)
    placed = (
        output.previous.assignment @ output.previous.correspondence,
        (output.current.assignment @ output.current.correspondence),
    )
    assert float(parts["auxiliary"]) == pytest.approx(
        sum(chamfer_loops(p, output.prior.points) for p in placed) / 2, rel=1e-4
    )


def chamfer_loops(placed, prior):
    """Both terms of L_aux, as means."""
    forward = [
        min(float((p - k).square().sum()) for k in placed[b]) for b in range(2) for p in prior[b]
    ]
    backward = [
        min(float((p - k).square().sum()) for p in prior[b]) for b in range(2) for k in placed[b]
    ]
    return sum(forward) / len(forward) + sum(backward) / len(backward)


def test_matching_loss_is_the_mean_over_true_matches():
    log_p = dual_softmax(torch.randn(2, 4, 5))
    matches = torch.zeros(2, 4, 5, dtype=torch.bool)
    assert matching_loss(log_p, matches) == 0.0
    chosen = [(0, 1, 2), (0, 3, 0), (1, 0, 4)]
    for index in chosen:
        matches[index] = True
    expected = -sum(float(log_p[index]) for index in chosen) / 3
    assert float(matching_loss(log_p, matches)) == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("degrees", [0.0, 1e-3, 1.0, 90.0, 170.0, 180.0])
def test_rotation_loss_is_the_angle_and_its_gradient_is_finite(degrees):
    R = about_y(math.radians(degrees))[None].requires_grad_()
    loss = rotation_loss(R, torch.eye(3)[None])
    loss.sum().backward()
    assert R.grad is not None
    assert torch.isfinite(R.grad).all()
    assert float(loss.detach()) == pytest.approx(
        math.radians(min(degrees, 174.9)), abs=2e-3, rel=1e-3
    )


def test_expected_error_is_least_at_the_true_error():
    distance = torch.full((1000,), 0.07)
    u = torch.linspace(-6, 1, 1000, requires_grad=True)
    best = u.detach()[expected_error_loss(distance, u).argmin()]
    assert float(best.exp()) == pytest.approx(0.07, rel=0.02)
    moved = torch.full((3,), 0.1, requires_grad=True)
    expected_error_loss(moved, torch.zeros(3, requires_grad=True)).sum().backward()
    assert moved.grad is None  # it judges the errors, it does not move what errs


@torch.no_grad()
def test_a_symmetric_objects_turn_costs_nothing():
    """Truth turned about y by any angle, in each view: a perfect answer stays perfect."""
    views, truth, cloud = make_pair()
    output = perfect_output(views, truth, cloud)
    for turn_prev, turn_cur in ((0.7, 0.7), (0.0, 1.1), (-2.0, 3.0)):
        T_prev, T_cur = truth.T_cam_obj_prev.clone(), truth.T_cam_obj_cur.clone()
        T_prev[:, :3, :3] @= about_y(turn_prev)
        T_cur[:, :3, :3] @= about_y(turn_cur)
        turned = replace(truth, T_cam_obj_prev=T_prev, T_cam_obj_cur=T_cur)
        symmetric = replace(turned, symmetric=torch.tensor([True, True]))
        _, parts = pair_losses(output, symmetric, LossConfig(translation="exact"))
        for name in MOTION:
            assert parts[name] < 2e-3, name
        _, parts = pair_losses(output, turned, LossConfig())
        assert parts["anchor"] > 0.05


@torch.no_grad()
def test_the_turn_chosen_is_the_nearest_one_and_shared():
    views, truth, _ = make_pair(seed=5, symmetric=True)
    torch.manual_seed(2)
    output = Robust6DofNet(CONFIG)(*views, random_prior(CONFIG))
    targets = make_targets(output, truth)

    def motion_error(angle):
        R = truth.T_cam_obj_cur[:, :3, :3] @ about_y(angle) @ truth.T_cam_obj_prev[:, :3, :3].mT
        moved = targets.to_loss_axes(output.previous.keypoints_cam) @ R.mT
        gap = (
            targets.to_loss_axes(output.current.keypoints_cam) - moved - targets.t_cur_prev[:, None]
        )
        return gap.square().sum((1, 2))

    moved = targets.to_loss_axes(output.previous.keypoints_cam) @ targets.R_cur_prev.mT
    gap = targets.to_loss_axes(output.current.keypoints_cam) - moved - targets.t_cur_prev[:, None]
    chosen = gap.square().sum((1, 2))
    for angle in np.linspace(-math.pi, math.pi, 73):
        assert (motion_error(float(angle)) >= chosen - 1e-5).all()
    # Shared: the views' canonical frames differ by exactly the change of the motion's losses.
    change = targets.current.R_cam_obj @ targets.previous.R_cam_obj.mT
    torch.testing.assert_close(change, targets.R_cur_prev, atol=1e-5, rtol=1e-5)


@torch.no_grad()
def test_prior_points_in_view_are_those_near_what_is_seen():
    views, truth, cloud = make_pair()
    output = perfect_output(views, truth, cloud)
    half = cloud[..., 0] > 0
    truth = replace(truth, on_object_prev=half)
    targets = make_targets(output, truth, view_radius=0.1)
    for b in range(2):
        for j, p in enumerate(output.prior.points[b]):
            near = min(float((p - c).norm()) for c in cloud[b, half[b]])
            assert bool(targets.previous.prior_in_view[b, j]) == (near <= 0.1)


def test_the_literal_auxiliary_loss_needs_equal_numbers():
    views, truth, _ = make_pair()
    config = LossConfig(auxiliary="literal")
    with pytest.raises(InputError, match="as many prior points"):
        pair_losses(Robust6DofNet(CONFIG)(*views, random_prior(CONFIG)), truth, config)
    equal = replace(CONFIG, prior_points=CONFIG.points)
    _, parts = pair_losses(Robust6DofNet(equal)(*views, random_prior(equal)), truth, config)
    assert parts["auxiliary"] > 0


def test_loss_sets_are_those_of_the_papers_ablation():
    paper = {"rotation", "translation", "auxiliary", "consistency", "matching"}
    used = [
        {name for name, weight in vars(config.weights).items() if weight > 0} & paper
        for config in LOSS_SETS.values()
    ]
    base = {"rotation", "translation"}
    assert used == [base, base | {"auxiliary"}, paper - {"matching"}, paper]
    views, truth, _ = make_pair()
    output = Robust6DofNet(CONFIG)(*views, random_prior(CONFIG))
    for config in (*LOSS_SETS.values(), LossConfig(auxiliary="separation")):
        total, _ = pair_losses(output, truth, config)
        assert torch.isfinite(total)


@torch.no_grad()
def test_fitted_losses_against_the_solvers_of_numpy():
    """L_rot and L_tra `solved` through Kabsch, the anchor's fit through Umeyama."""
    views, truth, _ = make_pair(seed=4)
    torch.manual_seed(1)
    output = Robust6DofNet(CONFIG)(*views, random_prior(CONFIG))
    _, parts = pair_losses(output, truth, LossConfig())
    angle, shift, absolute = [], [], []
    for b in range(2):
        T_prev, T_cur = (T[b].double().numpy() for T in (truth.T_cam_obj_prev, truth.T_cam_obj_cur))
        k_prev, k_cur, weight = (
            x[b].double().numpy()
            for x in (
                output.previous.keypoints_cam,
                output.current.keypoints_cam,
                output.matches.coarse_weight,
            )
        )
        said = fit_rigid(k_prev, k_cur, weight) @ T_prev
        angle.append(rotation_error(said[:3, :3], T_cur[:3, :3]))
        shift.append(np.linalg.norm(said[:3, 3] - T_cur[:3, 3]) / float(truth.scale[b]))
        for view, T in ((output.previous, T_prev), (output.current, T_cur)):
            fit, scale = fit_similarity(
                view.canonical[b].double().numpy(),
                view.points[b].double().numpy(),
                view.point_weight[b].double().numpy() + 1e-6,
            )
            pred, unit = view.T_cam_pred[b].double().numpy(), float(view.scale[b])
            centre = pred[:3, :3] @ fit[:3, 3] * unit + pred[:3, 3]
            absolute.append(
                rotation_error(pred[:3, :3] @ fit[:3, :3], T[:3, :3])
                + 2.0 * np.linalg.norm(centre - T[:3, 3]) / unit
                + abs(math.log(scale * unit / float(truth.scale[b])))
            )
    assert float(parts["rotation"]) == pytest.approx(np.mean(angle), rel=1e-3)
    assert float(parts["translation"]) == pytest.approx(np.mean(shift), rel=1e-3)
    assert float(parts["anchor_fit"]) == pytest.approx(np.mean(absolute), rel=1e-3)


@torch.no_grad()
def test_view_losses_against_loops():
    views, truth, cloud = make_pair(seed=4)
    torch.manual_seed(1)
    output = Robust6DofNet(CONFIG)(*views, random_prior(CONFIG))
    seen = torch.rand(cloud.shape[:2], generator=torch.Generator().manual_seed(1)) < 0.6
    truth = replace(truth, on_object_cur=seen)
    _, parts = pair_losses(output, truth, LossConfig())
    expected = {"anchor": 0.0, "correspondence": 0.0, "anchor_error": 0.0, "foreground": 0.0}
    for view, mask in ((output.previous, torch.ones_like(seen)), (output.current, seen)):
        share = 0.5 / float(mask.sum())
        for b, i in mask.nonzero().tolist():
            gap = float((view.canonical[b, i] - cloud[b, i]).norm())
            u = float(view.log_error[b, i])
            expected["anchor"] += share * gap
            expected["correspondence"] += share * float(
                (view.correspondence[b, i] - cloud[b, i]).norm()
            )
            expected["anchor_error"] += share * (gap * math.exp(-u) + u)
        for on, logit in zip(mask.flatten(), view.foreground.flatten(), strict=True):
            p = 1.0 / (1.0 + math.exp(-float(logit)))
            expected["foreground"] -= 0.5 * math.log(p if on else 1.0 - p) / mask.numel()
    for name, value in expected.items():
        assert float(parts[name]) == pytest.approx(value, rel=1e-4), name


@torch.no_grad()
def test_true_matches_are_mutual_nearest_under_the_true_change():
    views, truth, _ = make_pair(seed=6)
    torch.manual_seed(1)
    output = Robust6DofNet(CONFIG)(*views, random_prior(CONFIG))
    targets = make_targets(output, truth, match_radius=0.2)
    change = truth.T_cam_obj_cur @ torch.linalg.inv(truth.T_cam_obj_prev)
    for b in range(2):
        moved = output.previous.keypoints_cam[b] @ change[b, :3, :3].T + change[b, :3, 3]
        gap = [
            [float((m - k).norm() / truth.scale[b]) for k in output.current.keypoints_cam[b]]
            for m in moved
        ]
        for i, row in enumerate(gap):
            for j, value in enumerate(row):
                column = [other[j] for other in gap]
                mutual = value == min(row) and value == min(column)
                assert bool(targets.matches[b, i, j]) == (mutual and value <= 0.2)
    assert targets.matches.any()
    assert not make_targets(output, truth, match_radius=1e-9).matches.any()


@torch.no_grad()
def test_losses_do_not_depend_on_the_cameras_axes_or_the_unit():
    views, truth, _ = make_pair(seed=8)
    G = torch.eye(4)
    G[:3, :3] = about_y(1.1) @ about_y(0.4)[[1, 2, 0]][:, [1, 2, 0]]
    G[:3, 3] = torch.tensor([0.2, -0.1, 0.3])

    def seen_from(T):  # the whole scene moved, then three times as large
        moved = G @ T
        moved[:, :3, 3] *= 3.0
        return moved

    moved_views = [
        replace(v, T_cam_pred=seen_from(v.T_cam_pred), scale=3.0 * v.scale) for v in views
    ]
    moved_truth = replace(
        truth,
        T_cam_obj_prev=seen_from(truth.T_cam_obj_prev),
        T_cam_obj_cur=seen_from(truth.T_cam_obj_cur),
        scale=3.0 * truth.scale,
    )
    torch.manual_seed(1)
    net, prior = Robust6DofNet(CONFIG), random_prior(CONFIG)
    for reading in ("printed", "exact", "solved"):
        config = LossConfig(translation=reading)
        _, here = pair_losses(net(*views, prior), truth, config)
        _, there = pair_losses(net(*moved_views, prior), moved_truth, config)
        assert set(here) == set(there)
        for name in here:
            torch.testing.assert_close(here[name], there[name], atol=2e-4, rtol=1e-3)
