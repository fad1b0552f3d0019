"""The factored maximum filter equals the paper's N × N × 2d form, forward and backward."""

import tracemalloc

import pytest
import torch
from torch.autograd import gradcheck
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_iter

from robust6dof.network import max_filter as module
from robust6dof.network import max_filter_numba, max_filter_triton
from robust6dof.network.max_filter import (
    max_filter,
    max_filter_literal,
    weighted_max,
    weighted_max_reference,
)


def draw(*shapes, dtype=torch.float64, device="cpu", seed=0):
    generator = torch.Generator().manual_seed(seed)
    return [
        torch.randn(*shape, generator=generator, dtype=dtype).to(device).requires_grad_()
        for shape in shapes
    ]


@pytest.fixture(params=["numba", "torch", "triton"])
def place(request, monkeypatch):
    """Device and number type of each path; Triton without a GPU through its interpreter."""
    if request.param == "numba":
        return {"dtype": torch.float64}
    monkeypatch.setattr(max_filter_numba, "supports", lambda weight: False)
    if request.param == "torch":
        return {"dtype": torch.float64}
    monkeypatch.setenv("TRITON_INTERPRET", "0" if torch.cuda.is_available() else "1")
    pytest.importorskip("triton", reason="needs Triton (and no GPU: its interpreter does)")
    monkeypatch.setattr(max_filter_triton, "supports", lambda weight: True)
    device = "cuda" if torch.cuda.is_available() else "cpu"
    return {"dtype": torch.float32, "device": device}


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


def assert_same_gradients(a, b, inputs):
    upstream = torch.randn_like(b)
    expected = torch.autograd.grad(b, inputs, upstream)
    for got, wanted in zip(torch.autograd.grad(a, inputs, upstream), expected, strict=True):
        torch.testing.assert_close(got, wanted)


def test_temporal_filter_equals_the_printed_form_and_its_gradients(place):
    shapes = (2, 7, 4), (2, 9, 4), (2, 7, 4), (5, 8), (5,)
    f_dot, f_prev, f_cur, weight, bias = draw(*shapes, **place)
    factored = max_filter(f_dot, f_prev, f_prev @ weight[:, :4].T) + f_cur @ weight[:, 4:].T + bias
    literal = paper_filter(f_dot, f_prev, f_prev, f_cur, weight, bias)
    torch.testing.assert_close(factored, literal)
    assert_same_gradients(factored, literal, (f_dot, f_prev, f_cur, weight, bias))


def test_shape_filter_equals_the_printed_form_and_its_gradients(place):
    shapes = (2, 6, 4), (2, 8, 4), (2, 8, 3), (5, 7), (5,)
    f_cur, f_prior, rho, weight, bias = draw(*shapes, **place)
    factored = max_filter(f_cur, f_prior, f_prior @ weight[:, :4].T, rho @ weight[:, 4:].T + bias)
    literal = paper_filter(f_cur, f_prior, f_prior, rho, weight, bias, pooled="j")
    torch.testing.assert_close(factored, literal)
    assert_same_gradients(factored, literal, (f_cur, f_prior, rho, weight, bias))


def test_without_gradients_every_path_gives_the_same(place):
    """The fused CPU path then runs kernels that keep no index."""
    query, key, value, offset = draw((2, 7, 4), (2, 9, 4), (2, 9, 6), (2, 9, 6), **place)
    for added in (None, offset):
        kept = max_filter(query, key, value, added, scale=0.5)
        with torch.no_grad():
            unkept = max_filter(query, key, value, added, scale=0.5)
            literal = max_filter_literal(query, key, value, added, scale=0.5)
        torch.testing.assert_close(kept.detach(), unkept)
        torch.testing.assert_close(unkept, literal)


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
    assert_same_gradients(blocked, max_filter_literal(query, key, value), (query, key, value))


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


@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize("with_offset", [False, True])
@pytest.mark.parametrize("with_index", [False, True])
def test_rows_shared_out_over_threads_change_nothing(monkeypatch, threads, with_offset, with_index):
    weight, value, offset = (x.detach() for x in draw((2, 37, 20), (2, 20, 9), (2, 20, 9)))
    offset = offset if with_offset else None
    expected, index = weighted_max_reference(weight, value, offset)
    before = torch.get_num_threads()
    monkeypatch.setattr(max_filter_numba, "_TASK_PRODUCTS", 4 * value[0].numel())
    try:
        torch.set_num_threads(threads)
        best, found = weighted_max(weight, value, offset, with_index)
    finally:
        torch.set_num_threads(before)
    torch.testing.assert_close(best, expected)
    assert found is None or torch.equal(found, index)


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a CUDA device with Triton")
@pytest.mark.parametrize("with_offset", [False, True])
def test_fused_gpu_kernel_equals_plain_torch_on_several_tiles(with_offset):
    pytest.importorskip("triton")
    weight, value, offset = (
        x.detach().cuda() for x in draw((2, 70, 90), (2, 90, 48), (2, 90, 48), dtype=torch.float32)
    )
    weight, offset = weight.softmax(-1), offset if with_offset else None
    expected, index = weighted_max_reference(weight, value, offset)
    best, found = weighted_max(weight, value, offset, with_index=True)
    torch.testing.assert_close(best, expected)
    assert torch.equal(found, index)


class Largest(TorchDispatchMode):
    """Remembers the largest tensor that any operation makes, of the backward pass too."""

    def __init__(self):
        super().__init__()
        self.numbers = 0

    def __torch_dispatch__(self, func, types, args=(), kwargs=None):
        out = func(*args, **(kwargs or {}))
        sizes = [x.numel() for x in tree_iter(out) if isinstance(x, torch.Tensor)]
        self.numbers = max([self.numbers, *sizes])
        return out


def test_no_tensor_grows_beyond_a_block_of_rows_forward_or_backward(monkeypatch):
    monkeypatch.setattr(module, "_BLOCK_ROWS", 16)
    inputs = draw((1, 96, 24), (1, 96, 24), (1, 96, 24))
    with Largest() as factored:
        max_filter(*inputs).sum().backward()
    assert factored.numbers <= 96 * 24
    with Largest() as literal:
        max_filter_literal(*inputs).sum().backward()
    assert literal.numbers == 96 * 96 * 24


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
