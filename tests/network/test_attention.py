"""Each attention against the paper's formula, written with loops."""

import math

import pytest
import torch

from robust6dof.network.attention import LowRankAttention, MultiHead, OffsetAttention

torch.manual_seed(0)
B, N, D, H, K = 2, 5, 8, 2, 3


def softmax(values):
    top = max(values)
    powers = [math.exp(v - top) for v in values]
    return [p / sum(powers) for p in powers]


def dot(a, b):
    return float((a * b).sum())


def attention_loops(q, k, v, scale):
    """Softmax(scale q kᵀ) v of [N, d], [M, d], [M, e]."""
    out = torch.zeros(len(q), v.shape[1])
    for i in range(len(q)):
        weight = softmax([scale * dot(q[i], k[j]) for j in range(len(k))])
        for j in range(len(k)):
            out[i] += weight[j] * v[j]
    return out


def heads_loops(q, k, v):
    width = D // H
    cut = [slice(h * width, (h + 1) * width) for h in range(H)]
    return torch.cat([attention_loops(q[:, c], k[:, c], v[:, c], width**-0.5) for c in cut], -1)


@torch.no_grad()
def test_multi_head():
    layer, x, memory = MultiHead(D, H), torch.randn(B, N, D), torch.randn(B, N + 2, D)
    key, value = layer.key_value(memory).chunk(2, -1)
    expected = [layer.out(heads_loops(layer.query(x)[b], key[b], value[b])) for b in range(B)]
    torch.testing.assert_close(layer(x, memory), torch.stack(expected))


@torch.no_grad()
def test_weight_shared_attention_eq_wsa():
    for scaled, scale in ((True, D**-0.5), (False, 1.0)):
        layer, image, points = (
            OffsetAttention(D, scaled),
            torch.randn(B, N, D),
            torch.randn(B, N, D),
        )
        f_c, f_g = layer(image, points)
        for b in range(B):
            for got, own, other in ((f_c[b], image[b], points[b]), (f_g[b], points[b], image[b])):
                q, _, v = layer.qkv(own).chunk(3, -1)
                k = layer.qkv(other).chunk(3, -1)[1]
                offset = attention_loops(q, k, v, scale) - q
                torch.testing.assert_close(got, layer.out(offset).clamp_min(0))


@torch.no_grad()
@pytest.mark.parametrize("shared", [False, True])
@pytest.mark.parametrize("average", [False, True])
def test_low_rank_attention_eq_msa_1(shared, average):
    layer = LowRankAttention(D, H, K, shared, average)
    x, context = torch.randn(B, N, D), torch.randn(B, N, D)
    got = layer(x, x, x, context)
    for b in range(B):
        rows = layer.contract(context[b]).T
        if average:
            rows = torch.stack([torch.tensor(softmax(row.tolist())) for row in rows])
        X, Y = rows[:K], rows[:K] if shared else rows[K:]
        # As printed: X_c · F(F̄^(k)), the linear layer first.
        expected = heads_loops(layer.query(x[b]), X @ layer.key(x[b]), Y @ layer.value(x[b]))
        torch.testing.assert_close(got[b], expected)


@torch.no_grad()
def test_low_rank_attention_does_not_grow_with_the_points():
    layer = LowRankAttention(D, H, K)
    x, context = torch.randn(1, N, D), torch.randn(1, N, D)
    twice = torch.cat([x, x], 1)
    torch.testing.assert_close(
        layer(twice, twice, twice, torch.cat([context, context], 1))[:, :N],
        layer(x, x, x, context),
    )
