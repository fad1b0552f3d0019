"""The PyTorch crop renderer against the exact rasteriser and closed forms."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest
import torch
import trimesh
from scipy.spatial.transform import Rotation

from robust6dof.errors import InputError
from robust6dof.geometry.transforms import make_transform
from robust6dof.rendering.crops import CropScene, pixel_rays, render_crops
from robust6dof.rendering.point_sampling import sample_points
from robust6dof.rendering.rasteriser import render
from robust6dof.rendering.scene import Camera, Light, MeshInstance, Scene
from robust6dof.rendering.splatting import splat
from robust6dof.rendering.surface_samples import SurfaceSamples
from robust6dof.shapes.mesh import Material, TexturedMesh

SIZE = 128
MATERIAL = Material(0.3, 20.0)


def textured(mesh: trimesh.Trimesh) -> TexturedMesh:
    vertices = np.asarray(mesh.vertices, float)
    vertices = vertices - (vertices.min(0) + vertices.max(0)) / 2
    rng = np.random.default_rng(0)
    pattern = cv2.GaussianBlur(rng.random((64, 64, 3)).astype(np.float32), (0, 0), 6.0)
    texture = ((pattern - pattern.min()) / np.ptp(pattern) * 200 + 30).astype(np.uint8)
    return TexturedMesh(vertices, np.asarray(mesh.faces), vertices[:, :2] * 4, texture, MATERIAL)


def open_tube() -> trimesh.Trimesh:
    """A cylinder's wall without ends: its inside can be seen and the mesh is not closed."""
    tube = trimesh.creation.cylinder(0.05, 0.12, sections=48)
    tube.update_faces(np.abs(tube.face_normals[:, 2]) < 0.5)
    return tube


MESHES = [
    textured(trimesh.creation.box([0.12, 0.08, 0.05])),
    textured(trimesh.creation.cylinder(0.035, 0.13, sections=48)),
    textured(trimesh.creation.torus(0.06, 0.02, 48, 24)),
    textured(trimesh.creation.annulus(0.035, 0.042, 0.09, sections=48)),
    textured(open_tube()),
]


@pytest.fixture(scope="module")
def samples() -> SurfaceSamples:
    return SurfaceSamples.from_meshes(MESHES, 30_000, seed=1)


def centred_scene(samples: SurfaceSamples, seed: int, fill: float = 0.7) -> CropScene:
    """Each object once, turned at random, filling most of its crop."""
    rng = np.random.default_rng(seed)
    transforms, intrinsics = [], []
    for i in range(samples.count):
        z = rng.uniform(0.5, 1.2)
        R = Rotation.random(random_state=rng).as_matrix()
        transforms.append(make_transform(R, np.array([0.01, -0.02, z])))
        focal = fill * SIZE * z / float(samples.scales[i])
        intrinsics.append([[focal, 0, 60.0], [0, focal, 66.0], [0, 0, 1]])
    return CropScene(
        object_index=torch.arange(samples.count),
        T_cam_obj=torch.tensor(np.array(transforms), dtype=torch.float32),
        K=torch.tensor(intrinsics, dtype=torch.float32),
        light_direction_cam=torch.tensor([0.6, 0.0, 0.8]).expand(samples.count, 1, 3),
        light_color=torch.full((samples.count, 1, 3), 0.6),
        ambient=torch.full((samples.count, 3), 0.3),
        specular=torch.full((samples.count,), MATERIAL.specular),
        shininess=torch.full((samples.count,), MATERIAL.shininess),
    )


def rasterised(scene: CropScene, i: int, extra: list[MeshInstance] | None = None):
    T_cam_obj = scene.T_cam_obj[i].double().numpy()
    instances = [MeshInstance(MESHES[int(scene.object_index[i])], T_cam_obj, 1), *(extra or [])]
    direction = scene.light_direction_cam[i, 0].double().numpy()
    color = tuple(scene.light_color[i, 0].tolist())
    lit = Scene(instances, [Light(direction, color)], tuple(scene.ambient[i].tolist()))
    return render(lit, Camera(scene.K[i].double().numpy(), SIZE, SIZE, np.eye(4)))


def off_edges(depth: np.ndarray) -> np.ndarray:
    """Pixels whose neighbours all lie on the same smooth surface."""
    spread = cv2.dilate(depth, np.ones((3, 3))) - cv2.erode(depth, np.ones((3, 3)))
    return (depth > 0) & (spread < 0.02)


@pytest.mark.parametrize("seed", range(4))
def test_depth_and_mask_agree_with_the_rasteriser(samples: SurfaceSamples, seed: int) -> None:
    scene = centred_scene(samples, seed)
    crops = render_crops(samples, scene, SIZE)
    for i in range(samples.count):
        exact = rasterised(scene, i)
        mask = crops.mask[i].numpy()
        union = (mask | (exact.ids == 1)).sum()
        assert (mask & (exact.ids == 1)).sum() / union >= 0.97
        inside = off_edges(exact.depth) & mask
        error = np.abs(crops.depth[i].numpy() - exact.depth)[inside]
        assert np.median(error) < 1e-3
        assert np.quantile(error, 0.95) < 2e-3
        assert ((exact.ids == 1) & ~mask).sum() < 0.004 * union  # no holes


def test_colors_agree_with_the_rasteriser(samples: SurfaceSamples) -> None:
    scene = centred_scene(samples, seed=7)
    crops = render_crops(samples, scene, SIZE)
    for i in range(samples.count):
        exact = rasterised(scene, i)
        inside = off_edges(exact.depth) & crops.mask[i].numpy()
        difference = crops.rgb[i].permute(1, 2, 0).numpy() * 255 - exact.rgb
        assert np.abs(difference[inside]).mean() < 4.0
        assert np.abs(difference[inside].mean()) < 1.0


def test_canonical_coordinates_lift_back_to_the_pixels(samples: SurfaceSamples) -> None:
    scene = centred_scene(samples, seed=3)
    crops = render_crops(samples, scene, SIZE)
    assert crops.canonical.abs().max() <= 0.5
    points_obj = crops.canonical * samples.scales[scene.object_index][:, None, None, None]
    points_cam = torch.einsum("bij,bjhw->bihw", scene.T_cam_obj[:, :3, :3], points_obj)
    points_cam = points_cam + scene.T_cam_obj[:, :3, 3, None, None]
    lifted = pixel_rays(scene.K, SIZE) * crops.depth[:, None]
    error = (points_cam - lifted).abs().amax(1)[crops.mask]
    assert error.max() < 1e-5
    assert (crops.canonical.abs().sum(1)[~crops.mask] == 0).all()


def test_an_occluder_hides_and_a_missing_one_does_not(samples: SurfaceSamples) -> None:
    scene = centred_scene(samples, seed=5)
    in_front = scene.T_cam_obj.clone()
    in_front[:, :3, 3] += torch.tensor([0.04, 0.0, -0.2])
    index = torch.tensor([1, -1, 0, 2, -1])
    occluded = replace(scene, occluder_index=index[:, None], T_cam_occluder=in_front[:, None])
    alone, crops = render_crops(samples, scene, SIZE), render_crops(samples, occluded, SIZE)
    assert (alone.visibility == 1).all()
    for i in range(samples.count):
        if index[i] < 0:
            assert (crops.mask[i] == alone.mask[i]).all()
            continue
        other = MeshInstance(MESHES[int(index[i])], in_front[i].double().numpy(), 2)
        exact = rasterised(scene, i, [other])
        visible = (exact.ids == 1).sum() / (rasterised(scene, i).ids == 1).sum()
        assert float(crops.visibility[i]) == pytest.approx(visible, abs=0.03)
        assert 0 < visible < 1
        assert np.mean((crops.depth[i].numpy() > 0) == (exact.depth > 0)) > 0.99


def test_the_table_is_an_exact_plane_behind_the_object(samples: SurfaceSamples) -> None:
    scene = centred_scene(samples, seed=6)
    normal = torch.nn.functional.normalize(torch.tensor([0.1, -0.8, -0.6]), dim=0)
    offset = (scene.T_cam_obj[:, :3, 3] * normal).sum(1) - 0.1
    plane = torch.cat([normal.expand(samples.count, 3), offset[:, None]], dim=1)
    crops = render_crops(samples, replace(scene, plane_cam=plane), SIZE)
    rays = pixel_rays(scene.K, SIZE)
    expected = offset[:, None, None] / (normal[None, :, None, None] * rays).sum(1)
    table = (crops.depth > 0) & ~crops.mask
    assert table.float().mean() > 0.3
    assert (crops.depth - expected)[table].abs().max() < 1e-5
    assert (crops.visibility == 1).all()
    # The object's shadow darkens part of the otherwise evenly lit table.
    levels = crops.rgb.mean(1)[table]
    assert levels.min() < 0.8 * levels.max()


def test_stretched_objects_are_drawn_like_stretched_meshes(samples: SurfaceSamples) -> None:
    scene = centred_scene(samples, seed=8, fill=0.5)
    stretch = np.diag([1.2, 0.8, 1.3, 1.0])
    T = scene.T_cam_obj @ torch.tensor(stretch, dtype=torch.float32)
    crops = render_crops(samples, replace(scene, T_cam_obj=T), SIZE)
    for i, mesh in enumerate(MESHES):
        stretched = replace(mesh, vertices=mesh.vertices @ stretch[:3, :3])
        instance = MeshInstance(stretched, scene.T_cam_obj[i].double().numpy(), 1)
        camera = Camera(scene.K[i].double().numpy(), SIZE, SIZE, np.eye(4))
        exact = render(Scene([instance]), camera)
        mask = crops.mask[i].numpy()
        assert (mask & (exact.ids == 1)).sum() / (mask | (exact.ids == 1)).sum() > 0.96
        inside = off_edges(exact.depth) & mask
        assert np.median(np.abs(crops.depth[i].numpy() - exact.depth)[inside]) < 1e-3


def test_an_object_partly_out_of_the_crop_and_one_behind_the_camera(
    samples: SurfaceSamples,
) -> None:
    scene = centred_scene(samples, seed=9)
    T = scene.T_cam_obj.clone()
    T[0, :3, 3] = torch.tensor([0.0, 0.0, -0.6])
    K = scene.K.clone()
    K[1:, 0, 2] = 2.0
    moved = replace(scene, T_cam_obj=T, K=K)
    splats = splat(samples, moved.object_index, T, K, SIZE)
    assert not splats.seen[0].any()
    exact = splat(samples, scene.object_index, scene.T_cam_obj, scene.K, SIZE)
    # The same image, 58 px to the left.
    for i in range(1, samples.count):
        assert (splats.seen[i, :, : SIZE - 58] == exact.seen[i, :, 58:]).float().mean() > 0.995


def test_the_same_input_gives_the_same_crops(samples: SurfaceSamples) -> None:
    scene = centred_scene(samples, seed=2)
    first, second = render_crops(samples, scene, SIZE), render_crops(samples, scene, SIZE)
    assert torch.equal(first.rgb, second.rgb)
    assert torch.equal(first.depth, second.depth)
    again = SurfaceSamples.from_meshes(MESHES, 30_000, seed=1)
    assert torch.equal(again.points, samples.points)


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU")
def test_cuda_draws_what_the_cpu_draws(samples: SurfaceSamples) -> None:
    scene = centred_scene(samples, seed=2)
    fields = {k: v.cuda() if isinstance(v, torch.Tensor) else v for k, v in vars(scene).items()}
    crops = render_crops(samples.to("cuda"), CropScene(**fields), SIZE)
    expected = render_crops(samples, scene, SIZE)
    assert (crops.mask.cpu() == expected.mask).float().mean() > 0.999
    assert (crops.depth.cpu() - expected.depth).abs().median() < 1e-6


def test_samples_lie_on_the_surface_and_cover_it_evenly(samples: SurfaceSamples) -> None:
    box = samples.points[0].T.numpy()
    half = np.array([0.06, 0.04, 0.025])
    np.testing.assert_allclose(np.abs(box / half).max(axis=1), 1.0, atol=1e-5)
    top = (np.abs(box[:, 2]) > half[2] - 1e-6).mean()
    area = np.array([0.12 * 0.08, 0.12 * 0.05, 0.08 * 0.05])
    assert top == pytest.approx(area[0] / area.sum(), abs=0.002)
    assert samples.closed.tolist() == [True, True, True, True, False]
    for i, mesh in enumerate(MESHES):
        diagonal = np.linalg.norm(np.ptp(mesh.vertices, axis=0))
        assert float(samples.scales[i]) == pytest.approx(diagonal, rel=1e-6)
    norms = samples.normals.norm(dim=1)
    assert (norms - 1).abs().max() < 1e-5


def test_meshes_that_cannot_be_sampled_are_refused() -> None:
    with pytest.raises(InputError, match="no mesh"):
        SurfaceSamples.from_meshes([])
    flat = replace(MESHES[0], vertices=np.zeros_like(MESHES[0].vertices))
    with pytest.raises(InputError, match="area"):
        SurfaceSamples.from_meshes([flat])


def test_sampled_points_are_valid_pixels_lifted() -> None:
    generator = torch.Generator().manual_seed(0)
    depth = torch.rand(3, 40, 40, generator=generator) + 0.5
    depth[:, ::3] = 0.0
    depth[0, 1, 5] = torch.nan
    mask = torch.zeros(3, 40, 40, dtype=torch.bool)
    mask[:, 10:30, 10:30] = True
    K = torch.tensor([[50.0, 0, 19], [0, 55, 20], [0, 0, 1]]).expand(3, 3, 3)
    points, pixels, valid = sample_points(depth, mask, K, 100, generator)
    assert valid.tolist() == [280, 280, 280]  # 14 of the 20 rows have depth
    for b in range(3):
        x, y = pixels[b].long().T
        assert mask[b, y, x].all()
        assert torch.equal(points[b, :, 2], depth[b, y, x])
        assert len({(int(i), int(j)) for i, j in pixels[b]}) == 100  # without repetition
        projected = points[b] @ K[b].T
        assert (projected[:, :2] / projected[:, 2:] - pixels[b]).abs().max() < 1e-4


def test_few_points_are_repeated_and_none_gives_zeros() -> None:
    depth = torch.zeros(3, 16, 16)
    depth[0, 3, 4], depth[0, 5, 6], depth[0, 7, 8] = 1.0, 2.0, 3.0
    depth[1, 2, 2] = 0.7
    K = torch.eye(3).expand(3, 3, 3)
    points, pixels, valid = sample_points(depth, torch.ones(3, 16, 16, dtype=torch.bool), K, 64)
    assert valid.tolist() == [3, 1, 0]
    values, counts = points[0, :, 2].unique(return_counts=True)
    assert values.tolist() == [1.0, 2.0, 3.0]
    assert counts.max() - counts.min() <= 1
    assert (pixels[1] == 2).all()
    assert not points[2].any()
    assert not pixels[2].any()


def test_sampling_follows_its_generator() -> None:
    depth = torch.rand(2, 64, 64) + 0.5
    mask = torch.ones(2, 64, 64, dtype=torch.bool)
    K = torch.eye(3).expand(2, 3, 3)
    drawn = [
        sample_points(depth, mask, K, 50, torch.Generator().manual_seed(seed))[1]
        for seed in (1, 1, 2)
    ]
    assert torch.equal(drawn[0], drawn[1])
    assert not torch.equal(drawn[0], drawn[2])
