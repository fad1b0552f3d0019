"""An object on a table among clutter, seen by a moving camera: frames with known poses."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import trimesh

from robust6dof.frames import RgbdFrame
from robust6dof.geometry.transforms import invert_transform, make_transform
from robust6dof.rendering.rasteriser import render
from robust6dof.rendering.scene import Camera, Light, MeshInstance, Scene
from robust6dof.rendering.sensor import StereoSensor, StereoSensorConfig
from robust6dof.shapes.mesh import ObjectModel, TexturedMesh
from robust6dof.shapes.procedural import make_object

WIDTH, HEIGHT = 640, 480
K = np.array([[615.0, 0.0, 320.0], [0.0, 615.0, 240.0], [0.0, 0.0, 1.0]])
OBJECT_ID = 1


@dataclass(frozen=True, eq=False)
class Shot:
    """One frame and the truth about it."""

    frame: RgbdFrame
    mask: np.ndarray
    T_cam_obj: np.ndarray


@dataclass(frozen=True, eq=False)
class Tabletop:
    """World axes are the object's: y up, origin at the object's centre; SI units."""

    model: ObjectModel
    clutter: Sequence[MeshInstance]
    sensor: StereoSensor
    with_object: bool = True

    def shoot(
        self, T_cam_world: np.ndarray, rng: np.random.Generator, stamp: float | None = None
    ) -> Shot:
        return self.shoot_object_at(np.eye(4), T_cam_world, rng, stamp)

    def shoot_object_at(
        self,
        T_world_obj: np.ndarray,
        T_cam_world: np.ndarray,
        rng: np.random.Generator,
        stamp: float | None = None,
    ) -> Shot:
        camera = Camera(K, WIDTH, HEIGHT, invert_transform(T_cam_world))
        target = MeshInstance(self.model.mesh, T_world_obj, OBJECT_ID)
        instances = [target, *self.clutter] if self.with_object else [*self.clutter]
        light = Light(np.array([0.4, -0.8, 0.45]), (0.6, 0.6, 0.6))
        rendering = render(Scene(instances, [light]), camera)
        frame = self.sensor.observe(rendering, camera, rng, stamp=stamp)
        return Shot(frame, rendering.ids == OBJECT_ID, T_cam_world @ T_world_obj)


def make_tabletop(
    category: str = "mug", seed: int = 0, *, noisy: bool = True, clutter: int = 4
) -> Tabletop:
    """A procedural object on a textured table, `clutter` boxes around it."""
    rng = np.random.default_rng(seed)
    model = make_object(category, seed)
    floor = -model.extents[1] / 2
    instances = [_block((1.4, 0.03, 1.4), np.array([0.1, floor - 0.015, 0.0]), 2, rng)]
    instances.append(_block((6.0, 0.02, 6.0), np.array([0.0, floor - 0.75, 0.0]), 3, rng))
    turn = rng.uniform(0, 2 * np.pi)
    for number in range(clutter):
        size = rng.uniform([0.05, 0.05, 0.05], [0.12, 0.16, 0.12])
        angle = turn + 2 * np.pi * number / clutter
        away = 0.5 * model.scale + rng.uniform(0.08, 0.2)
        centre = np.array([away * np.cos(angle), floor + size[1] / 2, away * np.sin(angle)])
        instances.append(_block(size, centre, 4 + number, rng))
    config = StereoSensorConfig.d435i() if noisy else StereoSensorConfig.perfect()
    return Tabletop(model, instances, StereoSensor(config))


def look_at_object(
    azimuth: float, elevation: float, distance: float, aim: Sequence[float] = (0.0, 0.0, 0.0)
) -> np.ndarray:
    """`T_cam_world` of a level camera at these angles [rad] and distance [m] from the object."""
    direction = np.array(
        [
            np.cos(elevation) * np.cos(azimuth),
            np.sin(elevation),
            np.cos(elevation) * np.sin(azimuth),
        ]
    )
    camera = distance * direction
    z = np.asarray(aim) - camera
    z = z / np.linalg.norm(z)
    x = np.cross(z, [0.0, 1.0, 0.0])
    x /= np.linalg.norm(x)
    R_cam_world = np.stack([x, np.cross(z, x), z])
    return make_transform(R_cam_world, -R_cam_world @ camera)


def approach(frames: int, rate: float = 20.0) -> Iterator[tuple[float, np.ndarray]]:
    """Stamps and `T_cam_world` of a guidance-like flight: from 1.4 m at 35° to 0.5 m at 78°, a
    quarter around the object, swaying by a tenth of a radian."""
    for index in range(frames):
        stamp = index / rate
        share = 0.5 - 0.5 * np.cos(np.pi * min(1.0, index / frames / 0.75))
        azimuth = 0.6 + 1.2 * share + 0.1 * np.sin(1.3 * stamp)
        elevation = np.deg2rad(35 + 43 * share)
        aim = [0.03 * np.sin(0.9 * stamp), 0.03 * np.sin(1.7 * stamp), 0.02 * np.cos(stamp)]
        yield stamp, look_at_object(azimuth, elevation, 1.4 - 0.9 * share, aim)


def _block(size, centre, instance_id: int, rng: np.random.Generator) -> MeshInstance:
    box = trimesh.creation.box(extents=size)
    vertices = np.asarray(box.vertices)[np.asarray(box.faces).ravel()]
    uv = (vertices @ rng.normal(size=(3, 2))) / 0.3
    mesh = TexturedMesh(vertices, np.arange(len(vertices)).reshape(-1, 3), uv, _speckle(rng))
    return MeshInstance(mesh, make_transform(np.eye(3), centre), instance_id)


def _speckle(rng: np.random.Generator) -> np.ndarray:
    coarse = rng.uniform(0, 50, (64, 64, 1)) + rng.uniform(70, 160, 3)
    return coarse.astype(np.uint8)
