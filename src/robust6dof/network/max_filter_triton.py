"""The fused GPU kernel of the maximum filter, where Triton is installed.

Equal to the reference by construction (same products, same maxima); the tests that say so run where
Triton is installed: on a CUDA device, or without one through Triton's interpreter.
"""

from __future__ import annotations

import functools
import importlib.util
from typing import Any, no_type_check

import torch
from torch import Tensor

_ROWS, _CHANNELS = 32, 32


def supports(weight: Tensor) -> bool:
    """CUDA tensors, with Triton installed."""
    return (
        weight.is_cuda
        and weight.dtype in (torch.float32, torch.float16, torch.bfloat16)
        and importlib.util.find_spec("triton") is not None
    )


def weighted_max(weight: Tensor, value: Tensor, offset: Tensor | None) -> tuple[Tensor, Tensor]:
    """max_j (weight [B R M] · value [B M C] + offset [B M C]), and which j (int32)."""
    weight, value = weight.contiguous(), value.contiguous()
    added = value if offset is None else offset.contiguous()
    (batch, rows, columns), channels = weight.shape, value.shape[2]
    best = torch.empty(batch, rows, channels, device=value.device, dtype=value.dtype)
    index = torch.empty(best.shape, device=value.device, dtype=torch.int32)
    grid = (-(-rows // _ROWS), -(-channels // _CHANNELS), batch)
    _kernel()[grid](
        weight, value, added, best, index, rows, columns, channels,
        HAS_OFFSET=offset is not None, ROWS=_ROWS, CHANNELS=_CHANNELS,
    )  # fmt: skip
    return best, index


@functools.cache
def _kernel() -> Any:
    import triton  # pyright: ignore[reportMissingImports]
    import triton.language as tl  # pyright: ignore[reportMissingImports]

    @triton.jit
    @no_type_check
    def kernel(
        weight, value, added, best, index, rows, columns, channels,
        HAS_OFFSET: tl.constexpr, ROWS: tl.constexpr, CHANNELS: tl.constexpr,
    ):  # fmt: skip
        i = tl.program_id(0) * ROWS + tl.arange(0, ROWS)
        c = tl.program_id(1) * CHANNELS + tl.arange(0, CHANNELS)
        b = tl.program_id(2).to(tl.int64)
        has_row, has_channel = i < rows, c < channels
        highest = tl.full((ROWS, CHANNELS), float("-inf"), tl.float32)
        where = tl.zeros((ROWS, CHANNELS), tl.int32)
        for j in range(columns):
            w = tl.load(weight + (b * rows + i) * columns + j, has_row, 0.0).to(tl.float32)
            place = (b * columns + j) * channels + c
            a = tl.load(value + place, has_channel, 0.0).to(tl.float32)
            product = w[:, None] * a[None, :]
            if HAS_OFFSET:
                product += tl.load(added + place, has_channel, 0.0).to(tl.float32)[None, :]
            better = product > highest
            highest = tl.where(better, product, highest)
            where = tl.where(better, j, where)
        place = (b * rows + i)[:, None] * channels + c[None, :]
        inside = has_row[:, None] & has_channel[None, :]
        tl.store(best + place, highest.to(best.dtype.element_ty), inside)
        tl.store(index + place, where, inside)

    return kernel
