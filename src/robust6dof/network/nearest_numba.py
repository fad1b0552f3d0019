"""The nearest point of a plane by a fused CPU kernel: no matrix of distances."""

from __future__ import annotations

from typing import no_type_check

import numba
import numpy as np
import torch
from jaxtyping import Float, Int
from torch import Tensor

from robust6dof.network.max_filter_numba import larger

_CHUNK = 64
"""Points searched together for the index of the nearest."""


def nearest_in_plane(
    keypoints: Float[Tensor, "B K 2"], points: Float[Tensor, "B N 2"]
) -> Int[Tensor, "B K"]:
    """Index of the point nearest to each keypoint; CPU tensors of one number type."""
    p = points.mT.contiguous().numpy()
    k = keypoints.contiguous().numpy()
    index = np.empty(k.shape[:2], np.int64)
    for b in range(len(k)):
        _search(k[b], p[b, 0], p[b, 1], (p[b] ** 2).sum(0), index[b])
    return torch.from_numpy(index)


@numba.njit(fastmath=True, nogil=True, cache=True)
@no_type_check
def _search(keypoints, x, y, square, index):
    """Nearest is where 2 k·p − ‖p‖² is largest; ‖k‖² is the same for all points."""
    two = x.dtype.type(2.0)
    for i in range(len(keypoints)):
        a, b = two * keypoints[i, 0], two * keypoints[i, 1]
        highest, chunk = x.dtype.type(-np.inf), 0
        for start in range(0, len(x), _CHUNK):
            found = x.dtype.type(-np.inf)
            for j in range(start, min(start + _CHUNK, len(x))):
                found = larger(a * x[j] + b * y[j] - square[j], found)
            if found > highest:
                highest, chunk = found, start
        where, least = chunk, x.dtype.type(np.inf)
        for j in range(chunk, min(chunk + _CHUNK, len(x))):
            gap = highest - (a * x[j] + b * y[j] - square[j])
            if gap < least:
                where, least = j, gap
        index[i] = where
