"""The three attentions of the paper: multi-head, offset (weight-shared) and low-rank."""

from __future__ import annotations

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn


def attend(query: Tensor, key: Tensor, value: Tensor, scale: float | None = None) -> Tensor:
    """Softmax(scale · q kᵀ) v over the last two axes; scale is 1/√d unless given."""
    return F.scaled_dot_product_attention(query, key, value, scale=scale)


def weighted_sum(
    query: Float[Tensor, "B N D"],
    key: Float[Tensor, "B M D"],
    value: Float[Tensor, "B M E"],
    scale: float,
) -> Float[Tensor, "B N E"]:
    """Softmax(scale · q kᵀ) v for a value of any width, without the N × M matrix.

    The fused attention of PyTorch asks for heads, and for one width; zeros fill up the others.
    """
    width = max(query.shape[-1], value.shape[-1])
    q, k, v = (F.pad(x, (0, width - x.shape[-1]))[:, None] for x in (query, key, value))
    return attend(q, k, v, scale)[:, 0, :, : value.shape[-1]]


def split_heads(x: Float[Tensor, "B N D"], heads: int) -> Float[Tensor, "B h N e"]:
    """Cut the features into heads."""
    return x.unflatten(-1, (heads, -1)).transpose(1, 2)


def merge_heads(x: Float[Tensor, "B h N e"]) -> Float[Tensor, "B N D"]:
    """Concatenate the heads again."""
    return x.transpose(1, 2).flatten(2)


class MultiHead(nn.Module):
    """Scaled dot-product attention with several heads."""

    def __init__(self, width: int, heads: int) -> None:
        super().__init__()
        self.heads = heads
        self.query = nn.Linear(width, width)
        self.key_value = nn.Linear(width, 2 * width)
        self.out = nn.Linear(width, width)

    def forward(
        self, query: Float[Tensor, "B N D"], memory: Float[Tensor, "B M D"]
    ) -> Float[Tensor, "B N D"]:
        """MultiHead(query, memory, memory)."""
        key, value = self.key_value(memory).chunk(2, -1)
        q, k, v = (split_heads(x, self.heads) for x in (self.query(query), key, value))
        return self.out(merge_heads(attend(q, k, v)))


class OffsetAttention(nn.Module):
    """Weight-shared attention, Eq. wsa-1 and wsa-2, for both modalities at once.

    F_c = φ(α(q(I) k(P)ᵀ) v(I) − q(I)) and the same with I and P exchanged; q, k, v and φ are the
    same for both.
    """

    def __init__(self, width: int, scaled: bool) -> None:
        super().__init__()
        self.scale = width**-0.5 if scaled else 1.0
        self.qkv = nn.Linear(width, 3 * width)
        self.out = nn.Linear(width, width)

    def forward(
        self, pixels: Float[Tensor, "B N D"], points: Float[Tensor, "B N D"]
    ) -> tuple[Float[Tensor, "B N D"], Float[Tensor, "B N D"]]:
        """The fused (F_c, F_g)."""
        q, k, v = self.qkv(torch.stack([pixels, points])).chunk(3, -1)
        offset = attend(q, k.flip(0), v, self.scale) - q
        f_c, f_g = F.relu(self.out(offset)).unbind(0)
        return f_c, f_g


class LowRankAttention(nn.Module):
    """Multi-head attention over k contracted keys, Eq. msa-1: O(N k) instead of O(N²).

    The contraction comes from `context`. With `average` a softmax over the N points normalises it,
    so that nothing grows with N; printed, it is bare. Each head's result is concatenated, without a
    further projection.
    """

    def __init__(
        self, width: int, heads: int, rank: int, shared: bool = False, average: bool = True
    ) -> None:
        super().__init__()
        self.heads, self.rank, self.shared, self.average = heads, rank, shared, average
        self.contract = nn.Linear(width, rank if shared else 2 * rank)
        self.query = nn.Linear(width, width)
        self.key = nn.Linear(width, width)
        self.value = nn.Linear(width, width)

    def forward(
        self,
        query: Float[Tensor, "B N D"],
        key: Float[Tensor, "B M D"],
        value: Float[Tensor, "B M D"],
        context: Float[Tensor, "B M D"],
    ) -> Float[Tensor, "B N D"]:
        """Softmax(q (X k)ᵀ/√d) · (Y v), heads concatenated."""
        contraction = self.contract(context).mT
        if self.average:
            contraction = contraction.softmax(-1)
        X, Y = (contraction, contraction) if self.shared else contraction.split(self.rank, 1)
        if self.average:  # rows sum to 1, so X F(k) = F(X k): contract before the linear layer
            k, v = self.key(X @ key), self.value(Y @ value)
        else:
            k, v = X @ self.key(key), Y @ self.value(value)
        q, k, v = (split_heads(x, self.heads) for x in (self.query(query), k, v))
        return merge_heads(attend(q, k, v))


class FeedForward(nn.Sequential):
    """Two linear layers."""

    def __init__(self, width: int, ratio: int) -> None:
        super().__init__(
            nn.Linear(width, ratio * width), nn.GELU(), nn.Linear(ratio * width, width)
        )
