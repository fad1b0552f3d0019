"""The sensor model for batches of crops, in PyTorch: the same effects as `sensor`, per crop.

Crops are enlarged or reduced parts of an image, so lengths given in image pixels are scaled by
each crop's focal length over the image's. The border of the stereo images is not modelled: a crop
does not know where in the image it lies.
"""

from __future__ import annotations

import math

import torch
import torch.nn.functional as F
from jaxtyping import Float
from torch import Tensor

from robust6dof.rendering.depth_model import SHINY_LUMINANCE, texture_features
from robust6dof.rendering.sensor_config import StereoSensorConfig

_LUMA = (0.299, 0.587, 0.114)
_SLOPE_SPAN_PX = 3


def observe_crop_depth(
    depth: Float[Tensor, "B S S"],
    rgb: Float[Tensor, "B 3 S S"],
    K: Float[Tensor, "B 3 3"],
    config: StereoSensorConfig,
    generator: torch.Generator | None = None,
    *,
    image_focal_px: float = 615.0,
    strength: Float[Tensor, "B"] | None = None,
) -> Float[Tensor, "B S S"]:
    """Depth of crops as a stereo camera would report it; 0 where it finds no match.

    Args:
        depth: exact depth [m]; 0 where there is nothing.
        rgb: exact colour, 0 … 1: dark and shiny surfaces drop out.
        K: intrinsics of the crops [px].
        config: which effects, how strong.
        generator: source of randomness, on the device of `depth`.
        image_focal_px: focal length of the whole image that the crops are cut from.
        strength: factor on the disparity noise of each crop.
    """
    focal_baseline = config.stereo_focal_px * config.baseline_m
    enlargement = K[:, 0, 0] / image_focal_px
    disparity = torch.where(depth > 0, focal_baseline / depth.clamp(min=1e-6), 0.0)
    matched = disparity
    if config.occlusion:
        matched = torch.where(_hidden(disparity, K, config.stereo_focal_px), 0.0, matched)
    matched = _fatten(disparity, matched, enlargement, config, generator)
    if config.disparity_noise_px > 0:
        noise = _smooth_noise(depth, config.noise_correlation_px, enlargement, generator)
        noise = noise * config.disparity_noise_px
        matched = torch.where(matched > 0, _add_noise(matched, noise, strength), 0.0)
    if config.disparity_step_px > 0:
        matched = (matched / config.disparity_step_px).round() * config.disparity_step_px
    smallest = focal_baseline / config.max_range_m if config.max_range_m > 0 else 0.0
    largest = config.max_disparity_px if config.max_disparity_px > 0 else torch.inf
    valid = (matched > max(smallest, 1e-6)) & (matched <= largest)
    measured = torch.where(matched == disparity, depth, focal_baseline / matched.clamp(min=1e-6))
    if config.depth_unit_m > 0:
        measured = (measured / config.depth_unit_m).round() * config.depth_unit_m
    probability = _dropout_by_appearance(depth, rgb, enlargement, image_focal_px, config)
    probability = torch.maximum(probability, _dropout_by_geometry(disparity, K, config))
    correlation = (config.dropout_correlation_px, config.dropout_correlation_px)
    field = _smooth_noise(depth, correlation, enlargement, generator)
    kept = torch.special.ndtr(field) >= probability
    return torch.where(valid & kept, measured, 0.0)


def observe_crop_color(
    rgb: Float[Tensor, "B 3 S S"],
    config: StereoSensorConfig,
    generator: torch.Generator | None = None,
    *,
    gains: Float[Tensor, "B 3"] | None = None,
    blur_px: Float[Tensor, "B 2"] | None = None,
) -> Float[Tensor, "B 3 S S"]:
    """Colour of crops as a camera would record it, 0 … 1.

    Args:
        rgb: exact colour, 0 … 1.
        config: strength of shot and read noise, exposure and white balance.
        generator: source of randomness, on the device of `rgb`.
        gains: further factors on red, green and blue of each crop.
        blur_px: how far each crop's image moves (x, y) during the exposure [crop px].
    """
    if blur_px is not None:
        rgb = _blur(rgb, blur_px)
    factors = config.exposure_gain * rgb.new_tensor(config.white_balance)
    rgb = rgb * (factors if gains is None else factors * gains).reshape(-1, 3, 1, 1)
    levels = rgb.clamp(0, 1) * 255.0
    sigma = (config.shot_noise * levels + config.read_noise**2).sqrt()
    noise = torch.randn(rgb.shape, generator=generator, device=rgb.device, dtype=rgb.dtype)
    return (rgb + sigma * noise / 255.0).clamp(0, 1)


def _add_noise(matched: Tensor, noise: Tensor, strength: Tensor | None) -> Tensor:
    return matched + (noise if strength is None else noise * strength[:, None, None])


def _hidden(disparity: Tensor, K: Tensor, stereo_focal_px: float) -> Tensor:
    """Pixels that the right imager cannot see: another lands at their place or left of it."""
    size = disparity.shape[-1]
    columns = torch.arange(size, device=disparity.device, dtype=disparity.dtype)
    landing = columns * (stereo_focal_px / K[:, 0, 0, None, None]) - disparity
    landing = torch.where(disparity > 0, landing, torch.inf)
    leftmost = landing.flip(-1).cummin(dim=-1).values.flip(-1)
    to_the_right = F.pad(leftmost[..., 1:], (0, 1), value=torch.inf)
    return (disparity > 0) & (landing > to_the_right + 0.5)


def _fatten(
    disparity: Tensor,
    matched: Tensor,
    enlargement: Tensor,
    config: StereoSensorConfig,
    generator: torch.Generator | None,
) -> Tensor:
    """Let near surfaces grow over their outlines by a smoothly varying width."""
    largest = float(enlargement.max())
    widest = round((config.edge_fattening_px + 2 * config.edge_jitter_px) * largest)
    if widest < 1:
        return matched
    width = torch.full_like(disparity, config.edge_fattening_px)
    if config.edge_jitter_px > 0:
        jitter = _smooth_noise(disparity, (3.0, 3.0), enlargement, generator)
        width = width + config.edge_jitter_px * jitter
    radius = (width * enlargement[:, None, None]).round()
    hidden = (disparity > 0) & (matched == 0)
    radius = torch.where(hidden, radius.clamp(min=1), radius)
    near = grown = disparity
    for i in range(1, widest + 1):
        grown = F.max_pool2d(grown[:, None], 3, 1, 1)[:, 0]
        near = torch.where(radius >= i, grown, near)
    step = torch.where(hidden, 0.5, 1.0) * config.edge_disparity_px
    return torch.where(near - disparity > step, near, matched)


def _dropout_by_appearance(
    depth: Tensor,
    rgb: Tensor,
    enlargement: Tensor,
    image_focal_px: float,
    config: StereoSensorConfig,
) -> Tensor:
    """As in `depth_model`; the window is that of the batch's mean enlargement."""
    luma = 255.0 * torch.einsum("bchw,c->bhw", rgb, rgb.new_tensor(_LUMA))
    probability = torch.where(luma > SHINY_LUMINANCE, config.shiny_dropout, 0.0)
    if config.fill_rate >= 1.0:
        return probability
    window = config.match_window_px * image_focal_px / config.stereo_focal_px
    side = 2 * round(window * float(enlargement.mean()) / 2) + 1
    mean, mean_sq = (_window_mean(x, side) for x in (luma, luma**2))
    contrast = (mean_sq - mean**2).clamp(min=0).sqrt().round().long().clamp(max=255)
    spots = -math.log(1.0 - config.fill_rate) * config.fill_range_m**2 / config.fill_level
    texture = torch.from_numpy(texture_features(config)).to(luma)[contrast]
    nothing = torch.exp(-(spots * luma / depth.clamp(min=1e-3) ** 2 + texture))
    return torch.maximum(probability, nothing)


def _window_mean(image: Tensor, side: int) -> Tensor:
    padded = F.pad(image, (side // 2,) * 4, mode="replicate")
    return F.avg_pool2d(padded[:, None], side, 1)[:, 0]


def _dropout_by_geometry(disparity: Tensor, K: Tensor, config: StereoSensorConfig) -> Tensor:
    cosine, at_outline = _incidence(disparity, K, config.edge_disparity_px)
    begin, complete = torch.cos(
        torch.deg2rad(torch.tensor(config.grazing_deg, dtype=torch.float64))
    )
    grazing = torch.zeros_like(cosine)
    if config.grazing_deg[0] < 90.0:
        grazing = ((float(begin) - cosine) / max(float(begin - complete), 1e-9)).clamp(0, 1)
    return torch.where(at_outline, config.edge_dropout, grazing)


def _incidence(disparity: Tensor, K: Tensor, step_px: float) -> tuple[Tensor, Tensor]:
    """Cosine of the angle of incidence, and whether an outline is near (see `depth_kernels`)."""
    slope_x, steps_x = _surface_slope(disparity, step_px)
    slope_y, steps_y = _surface_slope(disparity.transpose(1, 2), step_px)
    slope_y, steps_y = slope_y.transpose(1, 2), steps_y.transpose(1, 2)
    pixels = torch.arange(disparity.shape[-1], device=disparity.device, dtype=disparity.dtype)
    fx, fy = K[:, 0, 0, None, None], K[:, 1, 1, None, None]
    x = pixels[None, None, :] - K[:, 0, 2, None, None]
    y = pixels[None, :, None] - K[:, 1, 2, None, None]
    normal_sq = (fx * slope_x) ** 2 + (fy * slope_y) ** 2
    normal_sq = normal_sq + (disparity - slope_x * x - slope_y * y) ** 2
    ray_sq = (x / fx) ** 2 + (y / fy) ** 2 + 1.0
    return disparity / (normal_sq * ray_sq).sqrt().clamp(min=1e-9), steps_x | steps_y


def _surface_slope(disparity: Tensor, step_px: float) -> tuple[Tensor, Tensor]:
    padded = F.pad(disparity, (_SLOPE_SPAN_PX, _SLOPE_SPAN_PX), mode="replicate")
    back = disparity - padded[..., : -2 * _SLOPE_SPAN_PX]
    ahead = padded[..., 2 * _SLOPE_SPAN_PX :] - disparity
    gentler = torch.where(back.abs() < ahead.abs(), back, ahead)
    at_outline = (back + ahead - gentler).abs() - gentler.abs() > step_px
    return gentler / _SLOPE_SPAN_PX, at_outline


def _smooth_noise(
    like: Tensor,
    correlation_px: tuple[float, float],
    enlargement: Tensor,
    generator: torch.Generator | None,
) -> Tensor:
    """Gaussian fields of variance 1 with the correlation of `noise_fields`, scaled to each crop.

    White noise on a grid of σ (never finer than the crop's pixels) is smoothed by a Gaussian:
    two small matrix products per crop.
    """
    height, width = like.shape[1:]
    weights_x = _smoothing(correlation_px[0] * enlargement, width)
    weights_y = _smoothing(correlation_px[1] * enlargement, height)
    shape = (len(like), weights_y.shape[2], weights_x.shape[2])
    white = torch.randn(shape, generator=generator, device=like.device, dtype=like.dtype)
    return weights_y @ white @ weights_x.transpose(1, 2)


def _smoothing(sigma_px: Float[Tensor, "B"], length: int) -> Float[Tensor, "B P G"]:
    """Gaussian weights from grid nodes to pixels; each row's squares sum to one."""
    spacing = sigma_px.clamp(min=1.0)[:, None, None]
    sigma = (sigma_px[:, None, None] / spacing).clamp(min=1e-3)
    margin = 4
    count = int(length / float(spacing.min())) + 2 * margin
    pixels = torch.arange(length, device=sigma_px.device)[None, :, None] / spacing
    nodes = torch.arange(count, device=sigma_px.device)[None, None, :] - margin
    # Without correlation every pixel is its own node.
    weights = torch.exp(-0.5 * ((pixels - nodes) / sigma) ** 2)
    return weights / weights.norm(dim=2, keepdim=True)


def _blur(rgb: Tensor, blur_px: Tensor, samples: int = 5) -> Tensor:
    """Mean along a straight path of this length, centred."""
    size = rgb.shape[-1]
    identity = torch.eye(2, 3, device=rgb.device, dtype=rgb.dtype).expand(len(rgb), 2, 3)
    mean = torch.zeros_like(rgb)
    for i in range(samples):
        part = (i + 0.5) / samples - 0.5
        shifted = identity.clone()
        shifted[:, :, 2] = 2.0 * part * blur_px / size
        grid = F.affine_grid(shifted, list(rgb.shape), align_corners=False)
        mean += F.grid_sample(rgb, grid, padding_mode="border", align_corners=False) / samples
    return mean
