"""From a crop's depth and mask to the fixed number of points that the network takes."""

from __future__ import annotations

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor


def sample_points(
    depth: Float[Tensor, "B S S"],
    mask: Bool[Tensor, "B S S"],
    K: Float[Tensor, "B 3 3"],
    count: int,
    generator: torch.Generator | None = None,
) -> tuple[Float[Tensor, "B N 3"], Float[Tensor, "B N 2"], Int[Tensor, "B"]]:
    """Draw N points from the valid depth pixels inside the mask.

    Without repetition while there are enough; else each is repeated equally often (up to one).

    Args:
        depth: distance along the optical axis [m]; 0 (or anything not finite) is invalid.
        mask: where to draw from.
        K: intrinsics of these images [px].
        count: N.
        generator: source of randomness, on the device of `depth`.

    Returns:
        points_cam: [B, N, 3] in metres; zeros where a crop has no valid pixel.
        pixels: [B, N, 2] their (x, y); zeros where a crop has no valid pixel.
        valid: [B] how many valid pixels there were.
    """
    height, width = depth.shape[1:]
    usable = (mask & (depth > 0) & torch.isfinite(depth)).flatten(1)
    valid = usable.sum(dim=1)
    keys = torch.rand(usable.shape, device=depth.device, generator=generator)
    drawn = (keys + usable).topk(min(count, height * width), dim=1).indices
    turn = torch.arange(count, device=depth.device) % valid.clamp(1, drawn.shape[1])[:, None]
    chosen = drawn.gather(1, turn)
    some = (valid > 0)[:, None]
    z = depth.flatten(1).gather(1, chosen)
    z = torch.where(some, z, torch.zeros_like(z))
    column, row = chosen % width * some, chosen // width * some
    x = (column - K[:, 0, 2, None]) / K[:, 0, 0, None] * z
    y = (row - K[:, 1, 2, None]) / K[:, 1, 1, None] * z
    pixels = torch.stack([column, row], dim=-1).to(depth.dtype)
    return torch.stack([x, y, z], dim=-1), pixels, valid
