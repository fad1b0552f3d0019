"""The fused CPU kernels of the maximum filter.

Channels are stored as rows, so that the maximum runs over contiguous memory and LLVM turns it
into vector instructions; two rows and four channels at a time share their loads. The rows are
shared out over torch's threads.
"""

from __future__ import annotations

from typing import Any, no_type_check

import numba
import numpy as np
import torch
from llvmlite.ir import IRBuilder
from numba.extending import intrinsic
from torch import Tensor

from robust6dof.network.torch_threads import for_each

_TASK_PRODUCTS = 2**24
"""What one thread does at a time: a millisecond or less."""

_CHUNK = 64
"""Columns searched together for the index of a maximum."""


def supports(weight: Tensor) -> bool:
    """CPU tensors in float32 or float64."""
    return weight.device.type == "cpu" and weight.dtype in (torch.float32, torch.float64)


def weighted_max(
    weight: Tensor, value: Tensor, offset: Tensor | None, with_index: bool
) -> tuple[Tensor, Tensor | None]:
    """max_j (weight [B R M] · value [B M C] + offset [B M C]), and which j."""
    W, A = _as_array(weight), _as_array(value.mT)
    B = A if offset is None else _as_array(offset.mT)
    best = np.empty((W.shape[0], W.shape[1], A.shape[1]), A.dtype)
    index = np.empty(best.shape if with_index else (0, 0, 0), np.int32)

    def fill(task: tuple[int, slice]) -> None:
        b, rows = task
        if with_index:
            _max_and_index(
                W[b, rows], A[b], B[b], offset is not None, best[b, rows], index[b, rows]
            )
        elif offset is None:
            _max_product(W[b, rows], A[b], best[b, rows])
        else:
            _max_sum(W[b, rows], A[b], B[b], best[b, rows])

    step = 2 * -(-_TASK_PRODUCTS // (2 * A[0].size))  # even: two rows share their loads
    starts = range(0, W.shape[1], step)
    for_each(fill, [(b, slice(i, i + step)) for b in range(len(W)) for i in starts])
    return torch.from_numpy(best), torch.from_numpy(index) if with_index else None


def _as_array(tensor: Tensor) -> np.ndarray:
    return tensor.detach().contiguous().numpy()


@no_type_check
def _type_larger(_context: Any, a: Any, _b: Any) -> Any:
    @no_type_check
    def generate(_ctx: Any, builder: IRBuilder, _signature: Any, args: Any) -> Any:
        is_larger = builder.fcmp_ordered(">", args[0], args[1], flags=["fast"])
        return builder.select(is_larger, args[0], args[1], flags=["fast"])

    return a(a, a), generate


larger: Any = intrinsic(_type_larger)
"""max(a, b) as one instruction: numba's own max does not vectorise."""


@numba.njit(fastmath=True, nogil=True, cache=True)
@no_type_check
def _max_product(W, A, best):
    (rows, columns), channels = W.shape, A.shape[0]
    lowest = A.dtype.type(-np.inf)
    for i in range(0, rows, 2):
        i1 = min(i + 1, rows - 1)
        w, v = W[i], W[i1]
        for c in range(0, channels, 4):
            c1, c2, c3 = (
                min(c + 1, channels - 1),
                min(c + 2, channels - 1),
                min(c + 3, channels - 1),
            )
            a0, a1, a2, a3 = A[c], A[c1], A[c2], A[c3]
            m0 = m1 = m2 = m3 = n0 = n1 = n2 = n3 = lowest
            for j in range(columns):
                m0 = larger(w[j] * a0[j], m0)
                m1 = larger(w[j] * a1[j], m1)
                m2 = larger(w[j] * a2[j], m2)
                m3 = larger(w[j] * a3[j], m3)
                n0 = larger(v[j] * a0[j], n0)
                n1 = larger(v[j] * a1[j], n1)
                n2 = larger(v[j] * a2[j], n2)
                n3 = larger(v[j] * a3[j], n3)
            best[i, c], best[i, c1], best[i, c2], best[i, c3] = m0, m1, m2, m3
            best[i1, c], best[i1, c1], best[i1, c2], best[i1, c3] = n0, n1, n2, n3


@numba.njit(fastmath=True, nogil=True, cache=True)
@no_type_check
def _max_sum(W, A, B, best):
    (rows, columns), channels = W.shape, A.shape[0]
    lowest = A.dtype.type(-np.inf)
    for i in range(rows):
        w = W[i]
        for c in range(0, channels, 2):
            c1 = min(c + 1, channels - 1)
            a0, a1, b0, b1 = A[c], A[c1], B[c], B[c1]
            m0 = m1 = lowest
            for j in range(columns):
                m0 = larger(w[j] * a0[j] + b0[j], m0)
                m1 = larger(w[j] * a1[j] + b1[j], m1)
            best[i, c], best[i, c1] = m0, m1


@numba.njit(fastmath=True, nogil=True, cache=True)
@no_type_check
def _max_and_index(W, A, B, has_offset, best, index):
    (rows, columns), channels = W.shape, A.shape[0]
    lowest = A.dtype.type(-np.inf)
    for i in range(rows):
        w = W[i]
        for c in range(channels):
            a, b = A[c], B[c]
            highest, chunk = lowest, 0
            for start in range(0, columns, _CHUNK):
                stop = min(start + _CHUNK, columns)
                found = lowest
                if has_offset:
                    for j in range(start, stop):
                        found = larger(w[j] * a[j] + b[j], found)
                else:
                    for j in range(start, stop):
                        found = larger(w[j] * a[j], found)
                if found > highest:
                    highest, chunk = found, start
            where, nearest = chunk, A.dtype.type(np.inf)
            for j in range(chunk, min(chunk + _CHUNK, columns)):
                # The rounding here may differ from the vector code's by one fused operation.
                product = w[j] * a[j]
                if has_offset:
                    product += b[j]
                gap = highest - product
                if gap < nearest:
                    where, nearest = j, gap
            best[i, c], index[i, c] = highest, where
