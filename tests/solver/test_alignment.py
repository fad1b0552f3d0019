"""Weighted rigid and similarity fits: exact on exact data, stable on degenerate data."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from torch.autograd import gradcheck

from robust6dof.geometry.alignment import fit_rigid, fit_similarity
from robust6dof.geometry.differentiable_alignment import fit_rigid_torch, fit_similarity_torch
from robust6dof.geometry.transforms import make_transform, transform_points

seeds = st.integers(0, 2**31)


def draw(seed, count=12):
    rng = np.random.default_rng(seed)
    T = make_transform(Rotation.random(rng=rng).as_matrix(), rng.standard_normal(3))
    return T, rng.standard_normal((count, 3)), rng.random(count) + 0.1, rng


@settings(deadline=None, max_examples=30)
@given(seeds)
def test_exact_pairs_give_the_transform_and_the_scale(seed):
    T, src, w, rng = draw(seed)
    np.testing.assert_allclose(fit_rigid(src, transform_points(T, src), w), T, atol=1e-9)
    s = rng.uniform(0.1, 3.0)
    got, scale = fit_similarity(src, transform_points(T, s * src), w)
    np.testing.assert_allclose(got, T, atol=1e-9)
    assert scale == pytest.approx(s)


@settings(deadline=None, max_examples=20)
@given(seeds)
def test_no_small_motion_fits_better(seed):
    T, src, w, rng = draw(seed)
    dst = transform_points(T, src) + 0.2 * rng.standard_normal(src.shape)

    def cost(T, s=1.0):
        return float(w @ ((dst - transform_points(T, s * src)) ** 2).sum(-1))

    rigid, (similar, scale) = fit_rigid(src, dst, w), fit_similarity(src, dst, w)
    for _ in range(20):
        nudge = make_transform(
            Rotation.from_rotvec(1e-3 * rng.standard_normal(3)).as_matrix(),
            1e-3 * rng.standard_normal(3),
        )
        assert cost(nudge @ rigid) >= cost(rigid)
        assert cost(nudge @ similar, scale * (1 + 1e-3 * rng.standard_normal())) >= cost(
            similar, scale
        )


def test_batches_equal_single_fits():
    cases = [draw(seed) for seed in range(4)]
    src, w = np.stack([c[1] for c in cases]), np.stack([c[2] for c in cases])
    dst = np.stack([transform_points(c[0], c[1]) for c in cases])
    T, s = fit_similarity(src, dst, w)
    for i in range(4):
        one, scale = fit_similarity(src[i], dst[i], w[i])
        np.testing.assert_allclose(T[i], one)
        np.testing.assert_allclose(s[i], scale)


DEGENERATE = {
    "one point": np.zeros((5, 3)),
    "line": np.outer(np.linspace(-1, 1, 5), [1.0, 2.0, 0.5]),
    "plane": np.random.default_rng(0).standard_normal((6, 3)) * [1, 1, 0],
    "symmetric": np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0], [0, 0, 1.0], [0, 0, -1]]),
    "mirrored": np.random.default_rng(1).standard_normal((6, 3)),
}


@pytest.mark.parametrize("kind", DEGENERATE)
def test_degenerate_points_give_a_rotation_and_finite_gradients(kind):
    src = DEGENERATE[kind]
    dst = src * [1, 1, -1] if kind == "mirrored" else src @ Rotation.random(rng=3).as_matrix().T
    R = fit_rigid(src, dst)[:3, :3]
    np.testing.assert_allclose(R @ R.T, np.eye(3), atol=1e-9)
    assert np.linalg.det(R) == pytest.approx(1.0)
    if kind in ("plane", "symmetric"):
        np.testing.assert_allclose(src @ R.T, dst, atol=1e-9)
    inputs = [
        torch.tensor(x, dtype=torch.float32)[None].requires_grad_()
        for x in (src, dst, np.ones(len(src)))
    ]
    R, t, scale = fit_similarity_torch(*inputs)
    (R.sum() + t.sum() + scale.sum()).backward()
    assert torch.isfinite(R).all()
    for x in inputs:
        assert x.grad is not None
        assert torch.isfinite(x.grad).all()


def test_no_weight_gives_no_nan():
    src = torch.randn(1, 5, 3, requires_grad=True)
    R, t = fit_rigid_torch(src, torch.randn(1, 5, 3), torch.zeros(1, 5))
    (R.sum() + t.sum()).backward()
    assert src.grad is not None
    assert torch.isfinite(src.grad).all()
    assert np.isfinite(fit_rigid(np.ones((4, 3)), np.ones((4, 3)), np.zeros(4))).all()


def test_torch_equals_numpy():
    T, src, w, rng = draw(5)
    dst = transform_points(T, 1.7 * src) + 0.1 * rng.standard_normal(src.shape)
    inputs = [torch.from_numpy(x)[None] for x in (src, dst, w)]
    R, t = fit_rigid_torch(*inputs)
    expected = fit_rigid(src, dst, w)
    np.testing.assert_allclose(R[0], expected[:3, :3], atol=1e-9)
    np.testing.assert_allclose(t[0], expected[:3, 3], atol=1e-9)
    R, t, scale = fit_similarity_torch(*inputs)
    expected, s = fit_similarity(src, dst, w)
    np.testing.assert_allclose(R[0], expected[:3, :3], atol=1e-9)
    np.testing.assert_allclose(t[0], expected[:3, 3], atol=1e-9)
    assert float(scale[0]) == pytest.approx(float(s))


def as_leaves(*arrays):
    return [torch.from_numpy(np.array(x, float))[None].requires_grad_() for x in arrays]


@pytest.mark.parametrize("kind", ["general", "plane", "symmetric", "mirrored"])
def test_gradcheck_with_negligible_damping(kind):
    """A plane leaves one singular value at 0, a symmetric set has three equal ones."""
    T, src, _, rng = draw(2, count=6)
    src = DEGENERATE.get(kind, src)
    noise = 0.0 if kind == "plane" else 0.1
    dst = transform_points(T, src * [1, 1, -1] if kind == "mirrored" else src)
    dst = dst + noise * rng.standard_normal(src.shape)
    inputs = as_leaves(src, dst, rng.random(len(src)) + 0.5)
    assert gradcheck(lambda *x: fit_rigid_torch(*x, gradient_eps=1e-9), inputs)
    assert gradcheck(lambda *x: fit_similarity_torch(*x, gradient_eps=1e-9), inputs)


@pytest.mark.parametrize("kind", ["nearly a line", "symmetric"])
@pytest.mark.parametrize("size", [1e-3, 1.0, 100.0])
def test_damping_bounds_the_gradient_where_a_turn_is_free(kind, size):
    """A mirrored symmetric set, or a line: the free turn's gradient has no bound of its own."""
    rng = np.random.default_rng(4)
    thick = DEGENERATE["line"] + 1e-4 * rng.standard_normal((5, 3))
    src = size * (thick if kind == "nearly a line" else DEGENERATE[kind])
    dst = transform_points(draw(3)[0], src * [1, 1, -1])
    dst = dst + 1e-4 * size * rng.standard_normal(src.shape)
    inputs = as_leaves(src, dst, np.ones(len(src)))
    upstream = torch.from_numpy(rng.standard_normal((1, 3, 3)))

    def reach(eps):
        R, _ = fit_rigid_torch(*inputs, gradient_eps=eps)
        gradients = torch.autograd.grad(R, inputs[:2], upstream)
        return size * max(float(x.abs().max()) for x in gradients)

    assert reach(0.02) < 50.0
    assert reach(1e-9) > 100.0


def test_damping_hardly_bends_the_gradient_of_well_spread_points():
    T, src, w, rng = draw(7, count=30)
    inputs = as_leaves(src, transform_points(T, src) + 0.1 * rng.standard_normal(src.shape), w)
    upstream = torch.from_numpy(rng.standard_normal((1, 3, 3)))
    damped, exact = (
        torch.autograd.grad(fit_rigid_torch(*inputs, gradient_eps=eps)[0], inputs, upstream)
        for eps in (0.02, 1e-9)
    )
    for a, b in zip(damped, exact, strict=True):
        assert (a - b).norm() < 0.01 * b.norm()
