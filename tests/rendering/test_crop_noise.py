"""The sensor model for crops: its formulas, and agreement with the model for whole images."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from robust6dof.rendering.crop_noise import observe_crop_color, observe_crop_depth
from robust6dof.rendering.scene import Camera, Rendering
from robust6dof.rendering.sensor import StereoSensor, StereoSensorConfig

PERFECT = StereoSensorConfig.perfect()
FOCAL_BASELINE = PERFECT.stereo_focal_px * PERFECT.baseline_m
SIZE = 128


def intrinsics(batch: int, enlargement: float = 1.0) -> torch.Tensor:
    focal = 615.0 * enlargement
    return torch.tensor([[focal, 0, 63.5], [0, focal, 63.5], [0, 0, 1]]).expand(batch, 3, 3)


def observe(depth, config, *, level: float = 0.5, enlargement: float = 1.0, seed: int = 0, **more):
    rgb = torch.full((len(depth), 3, *depth.shape[1:]), level)
    generator = torch.Generator().manual_seed(seed)
    K = intrinsics(len(depth), enlargement)
    return observe_crop_depth(depth, rgb, K, config, generator, **more)


def wall(distance: float, batch: int = 32) -> torch.Tensor:
    return torch.full((batch, SIZE, SIZE), distance)


def step(near: float = 0.5, far: float = 1.0) -> torch.Tensor:
    depth = wall(far, 4)
    depth[:, 40:90, 60:100] = near
    return depth


def test_with_every_effect_off_nothing_changes() -> None:
    generator = torch.Generator().manual_seed(0)
    depth = torch.rand(4, SIZE, SIZE, generator=generator) * 3 + 0.2
    depth[torch.rand(depth.shape, generator=generator) < 0.2] = 0
    assert torch.equal(observe(depth, PERFECT), depth)
    rgb = torch.rand(4, 3, SIZE, SIZE, generator=generator)
    assert torch.equal(observe_crop_color(rgb, PERFECT, generator), rgb)


@pytest.mark.parametrize("enlargement", [0.4, 1.0, 2.0])
@pytest.mark.parametrize("distance", [0.5, 1.0])
def test_noise_follows_the_stereo_formula(distance: float, enlargement: float) -> None:
    config = replace(PERFECT, disparity_noise_px=0.08)
    measured = observe(wall(distance, 96), config, enlargement=enlargement)
    expected = distance**2 * 0.08 / FOCAL_BASELINE
    assert float(measured.std()) == pytest.approx(expected, rel=0.05)
    stronger = observe(
        wall(distance, 96), config, enlargement=enlargement, strength=torch.full((96,), 2.0)
    )
    assert float(stronger.std()) == pytest.approx(2 * expected, rel=0.05)


def test_noise_is_correlated_over_image_pixels_and_not_crop_pixels() -> None:
    config = replace(PERFECT, disparity_noise_px=0.08, noise_correlation_px=(6.0, 2.5))
    for enlargement in (0.5, 1.0):
        error = observe(wall(1.0, 96), config, enlargement=enlargement) - 1.0
        for lag in (2, 4, 8):
            along_x = (error[:, :, lag:] * error[:, :, :-lag]).mean() / error.var()
            along_y = (error[:, lag:] * error[:, :-lag]).mean() / error.var()
            image_lag = lag / enlargement
            assert float(along_x) == pytest.approx(np.exp(-(image_lag**2) / 144), abs=0.06)
            assert float(along_y) == pytest.approx(np.exp(-(image_lag**2) / 25), abs=0.06)


def test_quantisation() -> None:
    depth = torch.linspace(0.4, 1.5, SIZE).expand(1, SIZE, SIZE).contiguous()
    measured = observe(depth, replace(PERFECT, disparity_step_px=1 / 32))
    steps = FOCAL_BASELINE / measured.double() * 32
    assert (steps - steps.round()).abs().max() < 1e-3
    millimetres = observe(depth, replace(PERFECT, depth_unit_m=0.001)).double() * 1000
    assert (millimetres - millimetres.round()).abs().max() < 1e-2


@pytest.mark.parametrize(("enlargement", "width"), [(1.0, 3), (2.0, 6)])
def test_fattening_has_the_stated_width_in_image_pixels(enlargement: float, width: int) -> None:
    config = replace(PERFECT, edge_fattening_px=3.0)
    measured = observe(step(), config, enlargement=enlargement)
    expected = wall(1.0, 4)
    expected[:, 40 - width : 90 + width, 60 - width : 100 + width] = 0.5
    assert torch.allclose(measured, expected, atol=1e-6)


def test_effects_without_randomness_equal_those_for_whole_images() -> None:
    config = replace(PERFECT, occlusion=True, edge_fattening_px=2.0, disparity_step_px=1 / 32)
    y, x = np.mgrid[:SIZE, :SIZE]
    depth = (1.0 + 0.002 * (y - 64)).astype(np.float32)
    depth[40:90, 60:100] = 0.6 + 0.001 * (x[40:90, 60:100] - 80)
    rgb = np.full((SIZE, SIZE, 3), 128, np.uint8)
    camera = Camera(intrinsics(1)[0].double().numpy(), SIZE, SIZE, np.eye(4))
    rendering = Rendering(rgb, depth, np.ones(depth.shape, np.int32))
    expected = StereoSensor(config).observe(rendering, camera, np.random.default_rng(0)).depth
    measured = observe(torch.from_numpy(depth)[None], config)[0].numpy()
    assert (expected == 0).any()
    assert np.mean((measured == 0) == (expected == 0)) > 0.999
    both = (measured > 0) & (expected > 0)
    # The two compute in single and double precision: a value between two steps may go either way.
    assert np.mean(np.abs(measured - expected)[both] < 1e-5) > 0.999


@pytest.mark.parametrize(("level", "range_m"), [(0.0, 0.5), (10 / 255, 0.7), (0.8, 2.0)])
def test_plain_surfaces_drop_out_as_the_fill_rate_says(level: float, range_m: float) -> None:
    config = replace(PERFECT, fill_rate=0.9)
    dropped = observe(wall(range_m), config, level=level) == 0
    expected = 0.1 ** (level / 0.8 * (2.0 / range_m) ** 2)
    assert float(dropped.float().mean()) == pytest.approx(expected, abs=0.03)


def test_glare_blinds_with_its_probability() -> None:
    config = replace(PERFECT, shiny_dropout=0.7)
    dropped = observe(wall(1.0), config, level=1.0) == 0
    assert float(dropped.float().mean()) == pytest.approx(0.7, abs=0.03)


def test_dropouts_at_grazing_incidence() -> None:
    config = replace(PERFECT, grazing_deg=(70.0, 82.0))
    pixels = (torch.arange(SIZE) - 63.5) / 615.0
    for angle_deg, expected in ((50.0, 0.0), (75.0, 0.41), (86.0, 1.0)):
        # A plane through (0, 0, 0.8) turned about the camera's x axis.
        slope = np.tan(np.radians(angle_deg))
        depth = (0.8 / (1 - slope * pixels)).float()[:, None].expand(48, SIZE, SIZE).contiguous()
        middle = observe(depth, config)[:, 62:66]
        assert float((middle == 0).float().mean()) == pytest.approx(expected, abs=0.08)


def test_range_limits() -> None:
    config = replace(PERFECT, max_disparity_px=126.0, max_range_m=4.0)
    nearest = FOCAL_BASELINE / 126.0
    assert not observe(wall(nearest * 0.99, 1), config).any()
    assert observe(wall(nearest * 1.01, 1), config).all()
    assert observe(wall(3.9, 1), config).all()
    assert not observe(wall(4.1, 1), config).any()


def test_color_noise_gains_and_blur() -> None:
    config = replace(PERFECT, shot_noise=0.05, read_noise=1.5)
    rgb = torch.full((8, 3, SIZE, SIZE), 0.4)
    generator = torch.Generator().manual_seed(0)
    noisy = observe_crop_color(rgb, config, generator) * 255
    assert float(noisy.var()) == pytest.approx(0.05 * 0.4 * 255 + 1.5**2, rel=0.03)
    gains = torch.tensor([[1.2, 1.0, 0.5]]).expand(8, 3)
    scaled = observe_crop_color(rgb, PERFECT, generator, gains=gains)
    assert torch.allclose(scaled[0, :, 0, 0], torch.tensor([0.48, 0.4, 0.2]))
    edge = torch.zeros(2, 3, SIZE, SIZE)
    edge[..., 64:] = 1.0
    blurred = observe_crop_color(edge, PERFECT, blur_px=torch.tensor([[8.0, 0.0], [0.0, 8.0]]))
    width = ((blurred[0, 0, 60] > 0.01) & (blurred[0, 0, 60] < 0.99)).sum()
    assert 6 <= int(width) <= 8
    assert torch.allclose(blurred[1], edge[1], atol=1e-4)


def test_the_generator_decides() -> None:
    config = StereoSensorConfig.d435i()
    first, again, other = (observe(step(), config, seed=seed) for seed in (1, 1, 2))
    assert torch.equal(first, again)
    assert not torch.equal(first, other)
