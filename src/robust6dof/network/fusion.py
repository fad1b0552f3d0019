"""Stage 1: 2D-3D dense fusion. Pixels and points → the local descriptor F̃_obj."""

from __future__ import annotations

import math

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor, nn

from robust6dof.network.attention import LowRankAttention, MultiHead, OffsetAttention
from robust6dof.network.config import NetworkConfig
from robust6dof.network.inputs import ViewBatch


def sample_pixels(
    image: Float[Tensor, "B C H W"], pixels: Float[Tensor, "B N 2"], crop_px: int
) -> Float[Tensor, "B N C"]:
    """Bilinear look-up at crop pixels of a feature map that covers the same crop."""
    grid = (2.0 * pixels + 1.0) / crop_px - 1.0
    sampled = F.grid_sample(image, grid[:, None], align_corners=False, padding_mode="border")
    return sampled[:, :, 0].mT


class PixelStem(nn.Module):
    """Colour to `width` features at each point's pixel."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.layers = nn.ModuleList()
        channels = 3
        if config.pixel_stem == "cnn":
            for depth, width in enumerate(config.pixel_widths):
                stride = 2 if depth < 2 else 1
                layer = nn.Conv2d(channels, width, 3, stride, padding=1)
                nn.init.kaiming_normal_(layer.weight, nonlinearity="relu")
                self.layers.append(layer)
                channels = width
        extra = 3 if config.pixel_stem == "cnn" else 0
        self.out = nn.Linear(channels + extra, config.width)
        self.norm = nn.LayerNorm(config.width)

    def forward(self, view: ViewBatch) -> Float[Tensor, "B N D"]:
        image = 2.0 * view.rgb - 1.0
        crop_px = view.rgb.shape[-1]
        found = [sample_pixels(image, view.pixels, crop_px)]
        if self.layers:
            found.append(sample_pixels(self._convolve(image), view.pixels, crop_px))
        return self.norm(self.out(torch.cat(found, -1)))

    def _convolve(self, image: Tensor) -> Tensor:
        x = image.contiguous(memory_format=torch.channels_last)
        for layer in self.layers:
            x = F.relu(layer(x))
        return x


class PointStem(nn.Module):
    """Coordinates to features: a small PointNet (each point, then each point with the whole)."""

    def __init__(self, width: int, octaves: int = 4) -> None:
        super().__init__()
        self.frequencies: Tensor
        self.register_buffer(
            "frequencies", math.pi * 2.0 ** torch.arange(octaves).float(), persistent=False
        )
        self.local = nn.Sequential(
            nn.Linear(3 + 6 * octaves, width), nn.GELU(), nn.Linear(width, width)
        )
        self.whole = nn.Linear(width, width)
        self.out = nn.Linear(width, width)
        self.norm = nn.LayerNorm(width)

    def forward(self, points: Float[Tensor, "B N 3"]) -> Float[Tensor, "B N D"]:
        phase = (points[..., None] * self.frequencies).flatten(-2)
        x = self.local(torch.cat([points, phase.sin(), phase.cos()], -1))
        whole = self.whole(x.amax(1, keepdim=True))
        return self.norm(x + self.out(F.gelu(x + whole)))


class DenseFusion(nn.Module):
    """WSA and low-rank attention: F̃_obj of one frame."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        width = config.width
        self.config = config
        self.pixel_stem = PixelStem(config)
        self.point_stem = PointStem(width)
        if config.weight_shared_attention:
            self.wsa = OffsetAttention(width, config.similarity == "scaled")
        self.mlp_c = nn.Sequential(nn.Linear(width, width), nn.GELU(), nn.Linear(width, width))
        self.mlp_g = nn.Sequential(nn.Linear(width, width), nn.GELU(), nn.Linear(width, width))
        if config.dense_fusion == "off":
            self.attention = MultiHead(width, config.heads)
        else:
            shared, average = config.dense_fusion == "shared", config.contraction == "average"
            self.low_rank = LowRankAttention(width, config.heads, config.rank, shared, average)
        self.norm = nn.LayerNorm(width)

    def forward(self, view: ViewBatch) -> Float[Tensor, "B N D"]:
        pixels, points = self.pixel_stem(view), self.point_stem(view.points)
        f_c, f_g = pixels, points
        if self.config.weight_shared_attention:
            f_c, f_g = self.wsa(pixels, points)
        if self.config.fusion_residual:
            f_c, f_g = f_c + pixels, f_g + points
        f_c, f_g = self.mlp_c(f_c), self.mlp_g(f_g)
        if self.config.dense_fusion == "off":
            return self.norm(f_c + f_g + self.attention(f_c + f_g, f_c + f_g))
        fused = self.low_rank(f_g, f_g, f_g, context=f_c)
        # Printed, F̃_obj is the concatenation alone: then only the query tells points apart.
        return self.norm(fused + f_g + f_c) if self.config.fusion_residual else fused
