"""The maximum of weighted features over all points j, without the N × N × d tensor.

The paper's filters are MaxPool_j F([S̄(i,j) ⊙ f_j; g]) with F linear. As F([a; b]) = W₁a + W₂b,
they equal max_j (S̄(i,j)·A_jc + B_jc) with A = W₁f_j, and B = 0 (temporal; W₂f_i is added after)
or B = W₂ρ_j (shape). Here S̄ = softmax_j(scale · q_i·k_j).

Rows i are worked on in blocks: memory is O(block · N + N · d), forward and backward. The backward
pass keeps the index of each maximum and computes S̄ anew.
"""

from __future__ import annotations

from typing import Any

import torch
from jaxtyping import Float, Int
from torch import Tensor
from torch.autograd.function import once_differentiable

from robust6dof.network import max_filter_numba, max_filter_triton

_BLOCK_ROWS = 512
"""Rows of S̄ in memory at a time: at N = 2048 4 MB of float32, which a cache holds."""


def max_filter(
    query: Float[Tensor, "B N D"],
    key: Float[Tensor, "B M D"],
    value: Float[Tensor, "B M C"],
    offset: Float[Tensor, "B M C"] | None = None,
    scale: float = 1.0,
) -> Float[Tensor, "B N C"]:
    """max_j (softmax_j(scale · <query_i, key_j>) · value_jc + offset_jc); differentiable once."""
    return _MaxFilter.apply(query, key, value, offset, scale)  # pyright: ignore[reportReturnType]


def max_filter_literal(
    query: Float[Tensor, "B N D"],
    key: Float[Tensor, "B M D"],
    value: Float[Tensor, "B M C"],
    offset: Float[Tensor, "B M C"] | None = None,
    scale: float = 1.0,
) -> Float[Tensor, "B N C"]:
    """The same with the N × M × C tensor in memory: for tests at toy size."""
    weight = (scale * query @ key.mT).softmax(-1)
    product = weight[..., None] * value[:, None]
    return (product if offset is None else product + offset[:, None]).amax(2)


def weighted_max(
    weight: Float[Tensor, "B R M"],
    value: Float[Tensor, "B M C"],
    offset: Float[Tensor, "B M C"] | None,
    with_index: bool,
) -> tuple[Float[Tensor, "B R C"], Int[Tensor, "B R C"] | None]:
    """max_j (weight_ij · value_jc + offset_jc) of some rows, and which j (int32) if asked for.

    Fused on the CPU by numba and on a GPU by Triton; in plain PyTorch elsewhere.
    """
    if max_filter_numba.supports(weight):
        return max_filter_numba.weighted_max(weight, value, offset, with_index)
    if max_filter_triton.supports(weight):
        return max_filter_triton.weighted_max(weight, value, offset)
    return weighted_max_reference(weight, value, offset)


def weighted_max_reference(
    weight: Float[Tensor, "B R M"],
    value: Float[Tensor, "B M C"],
    offset: Float[Tensor, "B M C"] | None,
) -> tuple[Float[Tensor, "B R C"], Int[Tensor, "B R C"]]:
    """The same in plain PyTorch, one channel at a time so that nothing large is kept."""
    best, index = [], []
    for channel in range(value.shape[-1]):
        product = weight * value[:, None, :, channel]
        if offset is not None:
            product = product + offset[:, None, :, channel]
        found = product.max(-1)
        best.append(found.values)
        index.append(found.indices.to(torch.int32))
    return torch.stack(best, -1), torch.stack(index, -1)


class _MaxFilter(torch.autograd.Function):
    @staticmethod
    def forward(
        ctx: Any,
        query: Tensor,
        key: Tensor,
        value: Tensor,
        offset: Tensor | None,
        scale: float,
    ) -> Tensor:
        with_index = any(ctx.needs_input_grad)
        best, index = [], []
        A, B = value, offset
        if max_filter_numba.supports(value):  # as its kernels read them: once, not for every block
            A, B = _channels_first(value), None if offset is None else _channels_first(offset)
        for rows in _row_blocks(query):
            weight = _similarity(query[:, rows], key, scale)
            found, where = weighted_max(weight, A, B, with_index)
            best.append(found)
            index.append(where)
        if with_index:
            ctx.save_for_backward(query, key, value, torch.cat(index, 1))
            ctx.scale, ctx.has_offset = scale, offset is not None
        return torch.cat(best, 1)

    @staticmethod
    @once_differentiable
    def backward(ctx: Any, grad: Tensor) -> tuple[Tensor | None, ...]:  # pyright: ignore[reportIncompatibleMethodOverride]
        query, key, value, index = ctx.saved_tensors
        index = index.long()
        grad_query, grad_key = torch.empty_like(query), torch.zeros_like(key)
        grad_value = torch.zeros_like(value)
        for rows in _row_blocks(query):
            weight = _similarity(query[:, rows], key, ctx.scale)
            grad_rows, index_rows = grad[:, rows], index[:, rows]
            chosen = weight.gather(2, index_rows)
            grad_value.scatter_add_(1, index_rows, grad_rows * chosen)
            grad_weight = torch.zeros_like(weight).scatter_add_(
                2, index_rows, grad_rows * value.gather(1, index_rows)
            )
            inner = (grad_weight * weight).sum(-1, keepdim=True)
            grad_score = ctx.scale * weight * (grad_weight - inner)
            grad_query[:, rows] = grad_score @ key
            grad_key += grad_score.mT @ query[:, rows]
        grad_offset = None
        if ctx.has_offset:
            grad_offset = torch.zeros_like(value).scatter_add_(1, index, grad)
        return grad_query, grad_key, grad_value, grad_offset, None


def _similarity(query: Tensor, key: Tensor, scale: float) -> Tensor:
    score = (scale * query) @ key.mT
    in_place = score.dtype == query.dtype  # under autocast the softmax chooses its own
    return torch.softmax(score, -1, out=score if in_place else None)


def _row_blocks(query: Tensor) -> list[slice]:
    return [slice(start, start + _BLOCK_ROWS) for start in range(0, query.shape[1], _BLOCK_ROWS)]


def _channels_first(x: Tensor) -> Tensor:
    """The same numbers, each channel's side by side in memory."""
    return x.mT.contiguous().mT
