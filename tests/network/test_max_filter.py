"""The factored maximum filter equals the paper's N × N × 2d form, forward and backward."""

import tracemalloc

import pytest
import torch
from torch.autograd import gradcheck

from robust6dof.network import max_filter as module
from robust6dof.network.max_filter import (
    max_filter,
    max_filter_literal,
    weighted_max,
    weighted_max_reference,
)


def draw(*shapes, dtype=torch.float64, seed=0):
    generator = torch.Generator().manual_seed(seed)
    return [
        torch.randn(*shape, generator=generator, dtype=dtype, requires_grad=True)
        for shape in shapes
    ]


def paper_filter(query, key, feature, extra, weight, bias, pooled="i"):
    """MaxPool_j F([S̄(i,j) ⊙ f_j; g]) with loops; g = extra_i or extra_j."""
    similarity = torch.einsum("bid,bjd->bij", query, key).softmax(-1)
    rows = []
    for i in range(query.shape[1]):
        columns = []
        for j in range(key.shape[1]):
            other = extra[:, i] if pooled == "i" else extra[:, j]
            both = torch.cat([similarity[:, i, j, None] * feature[:, j], other], -1)
            columns.append(both @ weight.T + bias)
        rows.append(torch.stack(columns).amax(0))
    return torch.stack(rows, 1)


def test_temporal_filter_equals_the_printed_form_and_its_gradients():
    f_dot, f_prev, f_cur, weight, bias = draw((2, 7, 4), (2, 9, 4), (2, 7, 4), (5, 8), (5,))
    factored = max_filter(f_dot, f_prev, f_prev @ weight[:, :4].T) + f_cur @ weight[:, 4:].T + bias
    literal = paper_filter(f_dot, f_prev, f_prev, f_cur, weight, bias)
    torch.testing.assert_close(factored, literal)
    inputs = (f_dot, f_prev, f_cur, weight, bias)
    upstream = torch.randn_like(literal)
    got = torch.autograd.grad(factored, inputs, upstream)
    for a, b in zip(got, torch.autograd.grad(literal, inputs, upstream), strict=True):
        torch.testing.assert_close(a, b)


def test_shape_filter_equals_the_printed_form_and_its_gradients():
    f_cur, f_prior, place, weight, bias = draw((2, 6, 4), (2, 8, 4), (2, 8, 3), (5, 7), (5,))
    factored = max_filter(f_cur, f_prior, f_prior @ weight[:, :4].T, place @ weight[:, 4:].T + bias)
    literal = paper_filter(f_cur, f_prior, f_prior, place, weight, bias, pooled="j")
    torch.testing.assert_close(factored, literal)
    inputs = (f_cur, f_prior, place, weight, bias)
    upstream = torch.randn_like(literal)
    got = torch.autograd.grad(factored, inputs, upstream)
    for a, b in zip(got, torch.autograd.grad(literal, inputs, upstream), strict=True):
        torch.testing.assert_close(a, b)


@pytest.mark.parametrize("with_offset", [False, True])
def test_gradcheck(with_offset):
    query, key, value, offset = draw((2, 5, 3), (2, 6, 3), (2, 6, 4), (2, 6, 4))
    inputs = (query, key, value, offset if with_offset else None)
    assert gradcheck(lambda *x: max_filter(*x, scale=0.7), inputs)


@pytest.mark.parametrize("rows", [1, 3])
def test_blocks_of_rows_change_nothing(monkeypatch, rows):
    query, key, value = draw((2, 7, 4), (2, 9, 4), (2, 9, 6))
    monkeypatch.setattr(module, "_BLOCK_ROWS", rows)
    blocked = max_filter(query, key, value)
    torch.testing.assert_close(blocked, max_filter_literal(query, key, value))
    got = torch.autograd.grad(blocked.square().sum(), (query, key, value))
    whole = max_filter_literal(query, key, value).square().sum()
    for a, b in zip(got, torch.autograd.grad(whole, (query, key, value)), strict=True):
        torch.testing.assert_close(a, b)


@pytest.mark.parametrize("shape", [(1, 1, 1, 1), (2, 5, 130, 7), (1, 8, 64, 12)])
@pytest.mark.parametrize("with_offset", [False, True])
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_fused_cpu_kernels_equal_plain_torch(shape, with_offset, dtype):
    b, r, m, c = shape
    weight, value, offset = (x.detach() for x in draw((b, r, m), (b, m, c), (b, m, c), dtype=dtype))
    weight, offset = weight.softmax(-1), offset if with_offset else None
    expected, index = weighted_max_reference(weight, value, offset)
    best, none = weighted_max(weight, value, offset, with_index=False)
    assert none is None
    torch.testing.assert_close(best, expected)
    best, found = weighted_max(weight, value, offset, with_index=True)
    torch.testing.assert_close(best, expected)
    assert torch.equal(found, index)


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a CUDA device with Triton")
@pytest.mark.parametrize("with_offset", [False, True])
def test_fused_gpu_kernel_equals_plain_torch(with_offset):
    pytest.importorskip("triton")
    weight, value, offset = (
        x.detach().cuda() for x in draw((2, 70, 90), (2, 90, 48), (2, 90, 48), dtype=torch.float32)
    )
    weight, offset = weight.softmax(-1), offset if with_offset else None
    expected, index = weighted_max_reference(weight, value, offset)
    best, found = weighted_max(weight, value, offset, with_index=True)
    torch.testing.assert_close(best, expected)
    assert torch.equal(found, index)


def test_memory_at_paper_size_is_bounded():
    """The literal form would hold 2048 × 2048 × 128 float32 numbers, 2.1 GB."""
    query, key, value = (
        x.detach().requires_grad_()
        for x in draw((1, 2048, 128), (1, 2048, 128), (1, 2048, 128), dtype=torch.float32)
    )
    sizes = []
    with torch.autograd.graph.saved_tensors_hooks(
        lambda x: (sizes.append(x.numel() * x.element_size()), x)[1], lambda x: x
    ):
        tracemalloc.start()
        out = max_filter(query, key, value, scale=128**-0.5)
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
    assert sum(sizes) < 8e6  # three inputs and the indices
    assert peak < 64e6  # numpy's share: the two outputs
    assert torch.isfinite(out).all()
