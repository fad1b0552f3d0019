"""Time of the renderers and the sensor model: medians in ms, with the hardware.

OMP_NUM_THREADS=1 python benchmarks/bench_rendering.py [--threads 1] [--device cpu]
"""

from __future__ import annotations

import argparse
import platform
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
import trimesh

from robust6dof.geometry.transforms import make_transform
from robust6dof.rendering.crop_noise import observe_crop_color, observe_crop_depth
from robust6dof.rendering.crops import CropScene, render_crops
from robust6dof.rendering.point_sampling import sample_points
from robust6dof.rendering.rasteriser import render, render_depth
from robust6dof.rendering.scene import Camera, Light, MeshInstance, Scene
from robust6dof.rendering.sensor import StereoSensor, StereoSensorConfig
from robust6dof.rendering.surface_samples import SurfaceSamples
from robust6dof.shapes.mesh import Material, TexturedMesh

K = np.array([[615.0, 0.0, 319.5], [0.0, 615.0, 239.5], [0.0, 0.0, 1.0]])


def median_ms(function: Callable[[], object], repeats: int = 7) -> tuple[float, float]:
    """Median wall time and median processor time after one warm-up.

    The second is what one core needs when nothing else runs on the machine, or nearly so.
    """
    function()
    walls, cores = [], []
    for _ in range(repeats):
        wall, core = time.perf_counter(), time.process_time()
        function()
        walls.append(1000 * (time.perf_counter() - wall))
        cores.append(1000 * (time.process_time() - core))
    return float(np.median(walls)), float(np.median(cores))


def textured(mesh: trimesh.Trimesh) -> TexturedMesh:
    """A mesh with a random texture."""
    vertices = np.asarray(mesh.vertices, float)
    rng = np.random.default_rng(0)
    texture = rng.integers(0, 256, (256, 256, 3), dtype=np.uint8)
    return TexturedMesh(vertices, np.asarray(mesh.faces), vertices[:, :2] * 5, texture, Material())


def objects() -> list[TexturedMesh]:
    """Four objects, 15,000 triangles together."""
    return [
        textured(trimesh.creation.icosphere(subdivisions=4, radius=0.06)),
        textured(trimesh.creation.torus(0.05, 0.02, 64, 32)),
        textured(trimesh.creation.capsule(0.1, 0.03, count=[48, 48])),
        textured(trimesh.creation.annulus(0.04, 0.05, 0.1, sections=256)),
    ]


def tabletop() -> tuple[Scene, Camera]:
    """The objects on a table that fills the image, seen from above at 0.8 m."""
    table = textured(trimesh.creation.box([4.0, 4.0, 0.1]))
    instances = [MeshInstance(table, make_transform(np.eye(3), np.array([0, 0, 0.85])), 1)]
    for i, mesh in enumerate(objects()):
        T = make_transform(np.eye(3), np.array([-0.3 + 0.2 * i, 0.0, 0.72]))
        instances.append(MeshInstance(mesh, T, i + 2))
    lights = [
        Light(np.array([0.0, 0.6, 0.8]), (0.5, 0.5, 0.5)),
        Light(np.array([0.6, 0.0, 0.8]), (0.3, 0.3, 0.3)),
    ]
    return Scene(instances, lights), Camera(K, 640, 480, np.eye(4))


def crop_scene(samples: SurfaceSamples, batch: int, size: int, device: str) -> CropScene:
    """A batch of crops with a table and an occluder each."""
    generator = torch.Generator().manual_seed(0)
    index = torch.arange(batch) % samples.count
    T = torch.eye(4).repeat(batch, 1, 1)
    T[:, :3, :3] = torch.linalg.qr(torch.randn(batch, 3, 3, generator=generator)).Q
    T[:, :3, :3] *= torch.linalg.det(T[:, :3, :3])[:, None, None].sign()
    T[:, 2, 3] = 0.8
    occluder = T.clone()
    occluder[:, 0, 3], occluder[:, 2, 3] = 0.06, 0.7
    focal = 0.7 * size * 0.8 / samples.scales[index.to(samples.scales.device)].cpu()
    intrinsics = torch.zeros(batch, 3, 3)
    intrinsics[:, 0, 0] = intrinsics[:, 1, 1] = focal
    intrinsics[:, :2, 2], intrinsics[:, 2, 2] = size / 2, 1.0
    parts: dict[str, Any] = {
        "object_index": index,
        "T_cam_obj": T,
        "K": intrinsics,
        "light_direction_cam": torch.tensor([0.6, 0.0, 0.8]).expand(batch, 1, 3),
        "light_color": torch.full((batch, 1, 3), 0.6),
        "ambient": torch.full((batch, 3), 0.4),
        "specular": torch.full((batch,), 0.2),
        "shininess": torch.full((batch,), 20.0),
        "occluder_index": ((index + 1) % samples.count)[:, None],
        "T_cam_occluder": occluder[:, None],
        "plane_cam": torch.tensor([0.0, -0.6, -0.8, -0.75]).expand(batch, 4),
        "plane_texture": torch.rand(batch, 3, 64, 64, generator=generator),
    }
    return CropScene(**{name: value.to(device) for name, value in parts.items()})


def report(name: str, function: Callable[[], object], per: int = 1) -> None:
    wall, core = median_ms(function)
    rate = f" {1000 * per / wall:6.0f} crops/s wall {1000 * per / core:6.0f} per core" * (per > 1)
    print(f"{name:52s} {wall:8.1f} ms wall {core:8.1f} ms processor{rate}")


def processor() -> str:
    """The processor's name where Linux tells it."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    names = [line.split(":")[1].strip() for line in lines if line.startswith("model name")]
    return f"{names[0] if names else platform.machine()}, {len(names)} logical processors"


def bench_frames() -> None:
    scene, camera = tabletop()
    triangles = sum(len(instance.mesh.faces) for instance in scene.instances)
    print(f"640×480, {triangles} triangles, one thread")
    report("rasteriser, colour + depth + ids", lambda: render(scene, camera))
    report("rasteriser, depth + ids", lambda: render_depth(scene, camera))
    K_crop = K.copy()
    K_crop[:2, 2] -= [200, 180]
    crop_camera = Camera(K_crop, 128, 128, np.eye(4))
    report("rasteriser, one 128×128 crop of it", lambda: render(scene, crop_camera))
    rendering = render(scene, camera)
    sensor, rng = StereoSensor(StereoSensorConfig.d435i()), np.random.default_rng(0)
    twist = np.array([0.2, 0.1, 0.0, 0.5, 0.8, 0.3])
    report("sensor d435i, camera at rest", lambda: sensor.observe(rendering, camera, rng))
    report(
        "sensor d435i, 55°/s and 0.2 m/s, 8 ms exposure",
        lambda: sensor.observe(rendering, camera, rng, camera_twist=twist),
    )


def bench_crops(device: str, batch: int, points: int) -> None:
    samples = SurfaceSamples.from_meshes(objects(), points).to(device)
    generator = torch.Generator(device).manual_seed(0)
    config = StereoSensorConfig.d435i()

    def finish() -> None:
        if device == "cuda":
            torch.cuda.synchronize()

    print(f"crops on {device}, batch {batch}, {torch.get_num_threads()} thread(s), {points} points")
    for size in (96, 128):
        scene = crop_scene(samples, batch, size, device)
        crops = render_crops(samples, scene, size)

        def draw(scene: CropScene = scene, size: int = size) -> None:
            render_crops(samples, scene, size)
            finish()

        def degrade(scene: CropScene = scene, crops=crops) -> None:
            depth = observe_crop_depth(crops.depth, crops.rgb, scene.K, config, generator)
            observe_crop_color(crops.rgb, config, generator)
            sample_points(depth, crops.mask, scene.K, 1024, generator)
            finish()

        report(f"  {size}×{size} render (target, occluder, table)", draw, batch)
        report(f"  {size}×{size} sensor noise and 1024 points", degrade, batch)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--device", default="cpu")
    parser.add_argument("--batch", type=int, default=32)
    options = parser.parse_args()
    torch.set_num_threads(options.threads)
    print(processor())
    if options.device == "cpu":
        bench_frames()
    else:
        print(torch.cuda.get_device_name())
    for points in (10_000, 30_000):
        bench_crops(options.device, options.batch, points)


if __name__ == "__main__":
    main()
