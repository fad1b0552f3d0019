"""The sensor model against its own formulas, measured."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from robust6dof.errors import InputError
from robust6dof.geometry.transforms import make_transform
from robust6dof.rendering.noise_fields import smooth_noise
from robust6dof.rendering.rasteriser import render
from robust6dof.rendering.scene import Camera, MeshInstance, Rendering, Scene
from robust6dof.rendering.sensor import StereoSensor, StereoSensorConfig
from robust6dof.shapes.mesh import Material, TexturedMesh

K = np.array([[615.0, 0.0, 319.5], [0.0, 615.0, 239.5], [0.0, 0.0, 1.0]])
CAMERA = Camera(K, 640, 480, np.eye(4))
PERFECT = StereoSensorConfig.perfect()
FOCAL_BASELINE = PERFECT.stereo_focal_px * PERFECT.baseline_m


def flat(depth: np.ndarray, level: int = 128) -> Rendering:
    rgb = np.full((*depth.shape, 3), level, np.uint8)
    return Rendering(rgb, depth.astype(np.float32), np.ones(depth.shape, np.int32))


def wall(distance: float, level: int = 128) -> Rendering:
    return flat(np.full((480, 640), distance), level)


def step_scene(near: float = 0.5, far: float = 1.0) -> Rendering:
    """A near square in front of a far wall."""
    depth = np.full((480, 640), far)
    depth[180:300, 260:380] = near
    return flat(depth)


def tilted_plane(incidence_deg: float) -> Rendering:
    """A plane whose middle is seen at this angle."""
    y, x = np.mgrid[:480, :640]
    rays = np.stack([(x - 319.5) / 615, (y - 239.5) / 615, np.ones_like(x)], axis=-1)
    normal = Rotation.from_euler("x", incidence_deg, degrees=True).as_matrix()[:, 2]
    with np.errstate(divide="ignore"):
        depth = normal[2] * 0.8 / (rays @ normal)
    return flat(np.where((depth > 0) & (depth < 50), depth, 0))


def observe(
    rendering: Rendering,
    config: StereoSensorConfig,
    seed: int = 0,
    camera: Camera = CAMERA,
    **motion,
):
    return StereoSensor(config).observe(rendering, camera, np.random.default_rng(seed), **motion)


def test_with_every_effect_off_the_frame_is_the_rendering() -> None:
    rng = np.random.default_rng(3)
    rendering = Rendering(
        rng.integers(0, 256, (480, 640, 3), dtype=np.uint8),
        np.where(rng.random((480, 640)) < 0.8, rng.uniform(0.1, 20, (480, 640)), 0).astype("f4"),
        np.zeros((480, 640), np.int32),
    )
    frame = observe(rendering, PERFECT, stamp=2.5, name="000007")
    np.testing.assert_array_equal(frame.rgb, rendering.rgb)
    np.testing.assert_array_equal(frame.depth, rendering.depth)
    np.testing.assert_array_equal(frame.K, K)
    assert (frame.stamp, frame.name) == (2.5, "000007")


@pytest.mark.parametrize("distance", [0.5, 1.0, 2.0])
def test_depth_noise_follows_the_stereo_formula(distance: float) -> None:
    config = replace(PERFECT, disparity_noise_px=0.08)
    depths = np.stack([observe(wall(distance), config, seed).depth for seed in range(6)])
    expected = distance**2 * 0.08 / FOCAL_BASELINE
    assert np.std(depths) == pytest.approx(expected, rel=0.04)
    assert np.mean(depths) == pytest.approx(distance, abs=0.1 * expected)


def test_noise_is_correlated_as_stated() -> None:
    rng = np.random.default_rng(0)
    fields = np.stack([smooth_noise(240, 320, 6.0, 2.5, rng) for _ in range(20)])
    assert np.var(fields) == pytest.approx(1.0, rel=0.05)
    for lag in (2, 5, 10):
        along_x = np.mean(fields[:, :, lag:] * fields[:, :, :-lag])
        along_y = np.mean(fields[:, lag:] * fields[:, :-lag])
        assert along_x == pytest.approx(np.exp(-(lag**2) / (4 * 36)), abs=0.05)
        assert along_y == pytest.approx(np.exp(-(lag**2) / (4 * 6.25)), abs=0.05)
    white = smooth_noise(480, 640, 0.0, 0.0, rng)
    assert np.var(white) == pytest.approx(1.0, rel=0.02)
    assert abs(np.mean(white[:, 1:] * white[:, :-1])) < 0.01


def test_disparity_and_depth_come_in_steps() -> None:
    steps = replace(PERFECT, disparity_step_px=1 / 32)
    depth = observe(tilted_plane(40), steps).depth
    disparity = FOCAL_BASELINE / depth[depth > 0].astype(float) * 32
    assert np.abs(disparity - np.round(disparity)).max() < 1e-3
    exact = FOCAL_BASELINE / tilted_plane(40).depth[depth > 0].astype(float) * 32
    assert np.abs(disparity - exact).max() < 0.501
    millimetres = observe(tilted_plane(40), replace(PERFECT, depth_unit_m=0.001)).depth * 1000
    assert np.abs(millimetres - np.round(millimetres)).max() < 1e-2


def test_fattening_grows_the_near_surface_by_the_stated_width() -> None:
    config = replace(PERFECT, edge_fattening_px=3.0)
    depth = observe(step_scene(), config).depth
    near = np.zeros((480, 640), bool)
    near[177:303, 257:383] = True
    np.testing.assert_allclose(depth, np.where(near, 0.5, 1.0), atol=1e-6)


def test_fattening_jitters_around_its_mean_and_leaves_slopes_alone() -> None:
    config = replace(PERFECT, edge_fattening_px=3.0, edge_jitter_px=1.0)
    widths = (observe(step_scene(), config).depth[200:280] < 0.6).sum(axis=1) - 120
    assert widths.mean() == pytest.approx(6.0, abs=0.5)
    assert widths.std() > 0.5
    slope = tilted_plane(50)
    np.testing.assert_array_equal(observe(slope, config).depth, slope.depth)


def test_the_shadow_left_of_an_object_is_as_wide_as_the_disparity_step() -> None:
    depth = observe(step_scene(), replace(PERFECT, occlusion=True)).depth
    expected = K[0, 0] * PERFECT.baseline_m * (1 / 0.5 - 1 / 1.0)  # image pixels
    missing = depth == 0
    assert not missing[:, 260:].any()
    assert not missing[:180].any()
    assert not missing[300:].any()
    widths = missing[180:300].sum(axis=1)
    assert (np.abs(widths - expected) <= 1.0).all()
    assert missing[180:300, 259].all()


def test_pixels_whose_match_falls_off_the_right_image_are_invalid() -> None:
    # A stereo pair that is the colour image itself: the classic band at the left border.
    config = replace(PERFECT, occlusion=True, stereo_focal_px=615.0, stereo_width_px=639.0)
    missing = observe(wall(0.7), config).depth == 0
    width = 615.0 * 0.05 / 0.7
    assert (np.abs(missing.sum(axis=1) - width) <= 1).all()
    assert missing[:, : int(width) - 1].all()
    # The wider D435 stereo pair sees past the colour image's edge.
    assert (
        observe(wall(0.7), replace(PERFECT, occlusion=True, stereo_width_px=848.0)).depth > 0
    ).all()


def test_range_limits() -> None:
    config = replace(PERFECT, max_disparity_px=126.0, max_range_m=4.0)
    nearest = FOCAL_BASELINE / 126.0
    assert not observe(wall(nearest * 0.99), config).depth.any()
    assert observe(wall(nearest * 1.01), config).depth.all()
    assert observe(wall(3.9), config).depth.all()
    assert not observe(wall(4.1), config).depth.any()


@pytest.mark.parametrize(("incidence_deg", "expected"), [(60, 0.0), (75, 0.41), (86, 1.0)])
def test_dropouts_at_grazing_incidence(incidence_deg: float, expected: float) -> None:
    config = replace(PERFECT, grazing_deg=(70.0, 82.0))
    rendering = tilted_plane(incidence_deg)
    middle = np.s_[238:242, 150:490]
    dropped = [observe(rendering, config, seed).depth[middle] == 0 for seed in range(30)]
    begin, complete, here = np.cos(np.radians([70.0, 82.0, incidence_deg]))
    formula = np.clip((begin - here) / (begin - complete), 0, 1)
    assert formula == pytest.approx(expected, abs=0.02)
    assert np.mean(dropped) == pytest.approx(formula, abs=0.06)


def test_dropouts_along_outlines_only() -> None:
    config = replace(PERFECT, edge_dropout=0.4)
    hole = np.mean([observe(step_scene(), config, s).depth == 0 for s in range(40)], axis=0)
    beside_the_edge = np.r_[hole[200:280, 257:263].ravel(), hole[177:183, 280:360].ravel()]
    assert beside_the_edge.mean() == pytest.approx(0.4, abs=0.06)
    assert not hole[200:280, 270:370].any()
    assert not hole[:170].any()


@pytest.mark.parametrize(("level", "range_m"), [(0, 0.5), (10, 0.7), (204, 2.0), (204, 4.0)])
def test_plain_surfaces_drop_out_as_the_fill_rate_says(level: int, range_m: float) -> None:
    config = replace(PERFECT, fill_rate=0.9)
    dropped = [observe(wall(range_m, level), config, seed).depth == 0 for seed in range(4)]
    expected = 0.1 ** (level / 204.0 * (2.0 / range_m) ** 2)
    assert np.mean(dropped) == pytest.approx(expected, abs=0.02)


def test_texture_is_matched_where_the_projector_does_not_reach() -> None:
    config = replace(PERFECT, fill_rate=0.9)
    plain = wall(6.0, 60)
    rng = np.random.default_rng(0)
    grey = np.repeat(rng.integers(40, 80, (480, 640, 1)).astype(np.uint8), 3, axis=2)
    textured = Rendering(grey, plain.depth, plain.ids)
    assert (observe(plain, config).depth == 0).mean() > 0.8
    assert (observe(textured, config).depth == 0).mean() < 0.01


def test_glare_blinds_with_its_probability() -> None:
    config = replace(PERFECT, shiny_dropout=0.7)
    assert (observe(wall(1.0, 255), config).depth == 0).mean() == pytest.approx(0.7, abs=0.03)
    assert (observe(wall(1.0, 245), config).depth > 0).all()


def test_holes_are_blobs_and_not_single_pixels() -> None:
    config = replace(PERFECT, fill_rate=0.9)
    hole = np.array([observe(wall(2.0, 204), config, seed).depth == 0 for seed in range(6)])
    assert hole.mean() == pytest.approx(0.1, abs=0.01)
    beside_a_hole = hole[..., 1:][hole[..., :-1]].mean()
    assert beside_a_hole > 0.7  # 0.1 if pixels were independent


@pytest.mark.parametrize("level", [10, 100, 200])
def test_color_noise_is_shot_and_read_noise(level: int) -> None:
    config = replace(PERFECT, shot_noise=0.05, read_noise=1.5)
    rgb = observe(wall(1.0, level), config).rgb.astype(float)
    rounding = 1 / 12
    assert rgb.var() == pytest.approx(0.05 * level + 1.5**2 + rounding, rel=0.02)
    assert rgb.mean() == pytest.approx(level, abs=0.02)
    across = np.mean((rgb[:, 1:] - level) * (rgb[:, :-1] - level)) / rgb.var()
    assert abs(across) < 0.01
    assert abs(np.corrcoef(rgb[..., 0].ravel(), rgb[..., 1].ravel())[0, 1]) < 0.01


def test_exposure_and_white_balance_scale_the_colors() -> None:
    config = replace(PERFECT, exposure_gain=1.5, white_balance=(0.8, 1.0, 2.0))
    rgb = observe(wall(1.0, 100), config).rgb
    assert (rgb == [120, 150, 255]).all()


K_SMALL = np.array([[350.0, 0.0, 159.5], [0.0, 350.0, 119.5], [0.0, 0.0, 1.0]])
SMALL_CAMERA = Camera(K_SMALL, 320, 240, np.eye(4))


def textured_wall(distance: float) -> MeshInstance:
    """A wall with a smooth random pattern, 3 m wide."""
    rng = np.random.default_rng(5)
    pattern = cv2.GaussianBlur(rng.random((512, 512, 3)).astype(np.float32), (0, 0), 1.2)
    pattern = (pattern - pattern.min()) / np.ptp(pattern) * 255
    vertices = np.array([[-1.5, 1.5, 0], [1.5, 1.5, 0], [1.5, -1.5, 0], [-1.5, -1.5, 0.0]])
    uv = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
    mesh = TexturedMesh(
        vertices, np.array([[0, 2, 1], [0, 3, 2]]), uv, pattern.astype(np.uint8), Material(0.0)
    )
    return MeshInstance(mesh, make_transform(np.eye(3), np.array([0, 0, distance])), 1)


def average_of_renderings(scene: Scene, twist: np.ndarray, exposure_s: float) -> np.ndarray:
    """What the open shutter sees: the mean of many exact renderings along the motion."""
    images = []
    for t in (np.arange(16) + 0.5) / 16 * exposure_s - exposure_s / 2:
        T_world_cam = make_transform(Rotation.from_rotvec(t * twist[3:]).as_matrix(), t * twist[:3])
        images.append(
            render(scene, replace(SMALL_CAMERA, T_world_cam=T_world_cam)).rgb.astype(float)
        )
    return np.mean(images, axis=0)


@pytest.mark.parametrize(
    "twist",
    [
        [0, 0, 0, 0.8, -1.2, 0],
        [0, 0, 0, 0, 0, 3.0],
        [0.8, -0.5, 0.0, 0, 0, 0],
        [0.3, 0.2, 0.5, 0.4, 0.6, -0.5],
    ],
    ids=["pitch and yaw", "roll", "translation", "all"],
)
def test_motion_blur_is_the_mean_over_the_exposure(twist: list[float]) -> None:
    scene = Scene([textured_wall(0.9)], ambient=(1, 1, 1))
    motion = np.array(twist, float)
    blurred = observe(
        render(scene, SMALL_CAMERA),
        PERFECT,
        camera=SMALL_CAMERA,
        camera_twist=motion,
        exposure_s=0.03,
    ).rgb
    expected = average_of_renderings(scene, motion, 0.03)
    sharp = render(scene, SMALL_CAMERA).rgb.astype(float)
    inside = np.s_[20:-20, 20:-20]
    error = np.abs(blurred - expected)[inside]
    assert np.abs(sharp - expected)[inside].mean() > 6 * error.mean()
    assert error.mean() < 1.0
    assert np.quantile(error, 0.999) < 6.0


def test_what_moves_is_blurred_by_its_own_motion() -> None:
    """A wall that keeps up with the camera stays sharp; the same wall at rest does not."""
    rendering = render(Scene([textured_wall(0.9)], ambient=(1, 1, 1)), SMALL_CAMERA)
    twist, other = np.array([0.8, -0.5, 0, 0, 0.3, 0]), np.array([0, 0, 0, 0, 0, 2.0])
    wall_id = int(rendering.ids.max())

    def blurred(camera_twist: np.ndarray | None, **moving: np.ndarray) -> np.ndarray:
        twists = {wall_id: moving["wall"]} if moving else None
        return observe(
            rendering,
            PERFECT,
            camera=SMALL_CAMERA,
            camera_twist=camera_twist,
            instance_twists=twists,
            exposure_s=0.03,
        ).rgb

    np.testing.assert_array_equal(blurred(twist, wall=np.zeros(6)), rendering.rgb)
    np.testing.assert_array_equal(blurred(twist, wall=other), blurred(other))
    np.testing.assert_array_equal(blurred(None, wall=other), blurred(other))
    assert (blurred(twist) != rendering.rgb).mean() > 0.5


def test_a_rolling_shutter_leans_with_the_row() -> None:
    rgb = np.zeros((480, 640, 3), np.uint8)
    rgb[:, 320:] = 255
    rendering = Rendering(rgb, np.ones((480, 640), np.float32), np.ones((480, 640), np.int32))
    twist = np.array([0.4, 0, 0, 0, 0, 0])  # to the right: the scene moves to the left
    frame = observe(rendering, replace(PERFECT, readout_s=0.03), camera_twist=twist, exposure_s=0.0)
    edge = 640 - frame.rgb[..., 0].sum(axis=1) / 255.0
    expected = 320 - 615 * 0.4 * (np.arange(480) / 480 - 0.5) * 0.03
    np.testing.assert_allclose(edge, expected, atol=0.05)


def test_the_same_seed_gives_the_same_frame() -> None:
    rendering = render(Scene([textured_wall(0.9)], ambient=(1, 1, 1)), CAMERA)
    first, again, other = (observe(rendering, StereoSensorConfig.d435i(), s) for s in (1, 1, 2))
    np.testing.assert_array_equal(first.depth, again.depth)
    np.testing.assert_array_equal(first.rgb, again.rgb)
    assert (first.depth != other.depth).mean() > 0.1
    assert (first.rgb != other.rgb).mean() > 0.1


def test_units_differ_but_stay_usable() -> None:
    drawn = StereoSensorConfig.d435i().drawn(np.random.default_rng(0))
    assert drawn != StereoSensorConfig.d435i()
    assert drawn == StereoSensorConfig.d435i().drawn(np.random.default_rng(0))
    certain = StereoSensorConfig(edge_dropout=1.0, shiny_dropout=1.0)
    for seed in range(4):
        unit = certain.drawn(np.random.default_rng(seed))
        assert max(unit.edge_dropout, unit.shiny_dropout) <= 1.0
    frame = observe(wall(0.8), drawn)
    assert (frame.depth > 0).mean() > 0.95


def test_presets_and_unusable_settings() -> None:
    assert StereoSensorConfig.preset("perfect") == PERFECT
    assert StereoSensorConfig.preset("d435i") == StereoSensorConfig()
    with pytest.raises(InputError, match="preset"):
        StereoSensorConfig.preset("kinect")
    with pytest.raises(InputError, match="baseline"):
        StereoSensorConfig(baseline_m=0.0)
    with pytest.raises(InputError, match="fill_rate"):
        StereoSensorConfig(fill_rate=1.5)
    with pytest.raises(InputError, match="probabilities"):
        StereoSensorConfig(edge_dropout=1.5)
    with pytest.raises(InputError, match="read_noise"):
        StereoSensorConfig(read_noise=-1.0)
    with pytest.raises(InputError, match="exposure"):
        observe(wall(1.0), PERFECT, exposure_s=-1.0)
    with pytest.raises(InputError, match="size"):
        observe(flat(np.ones((240, 320))), PERFECT)
