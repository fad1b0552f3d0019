"""Close views of one object on a table among others: what training pairs are rendered from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, UInt8
from scipy.spatial.transform import Rotation

from robust6dof.frames import CATEGORIES, RgbdFrame
from robust6dof.geometry.transforms import invert_transform, make_transform
from robust6dof.rendering.noise_fields import smooth_noise
from robust6dof.rendering.rasteriser import render
from robust6dof.rendering.scene import Camera, Light, MeshInstance, Rendering, Scene
from robust6dof.shapes.mesh import Material, ObjectModel, TexturedMesh
from robust6dof.shapes.procedural import make_object
from robust6dof.shapes.textures import any_pattern

TARGET_ID = 1
OCCLUDER_ID = 99
"""`instance_id` of what comes between camera and target."""
_CLUTTER_POOL = 40


@dataclass(frozen=True, eq=False)
class CloseUp:
    """A scene about one object; its world is the object's own frame (y up, metres)."""

    target: ObjectModel
    scene: Scene

    @staticmethod
    def draw(
        rng: np.random.Generator,
        target: ObjectModel,
        R_obj_room: Float[np.ndarray, "3 3"] | None = None,
    ) -> CloseUp:
        """A table under the object (mostly), up to four neighbours, one to three lights.

        Args:
            rng: draws all of it.
            target: the object.
            R_obj_room: turns the room, whose y is up, to the object, so that it may lie on any
                side of its box; it stands upright if not given.
        """
        if R_obj_room is None:
            return CloseUp._drawn_upright(rng, target)
        mesh = replace(target.mesh, vertices=target.mesh.vertices @ R_obj_room)
        laid = CloseUp._drawn_upright(rng, replace(target, mesh=mesh))
        T_obj_room = make_transform(R_obj_room, np.zeros(3))
        room = [
            replace(thing, T_world_mesh=T_obj_room @ thing.T_world_mesh)
            for thing in laid.scene.instances[1:]
        ]
        lights = [
            replace(light, direction_world=R_obj_room @ light.direction_world)
            for light in laid.scene.lights
        ]
        itself = MeshInstance(target.mesh, np.eye(4), TARGET_ID)
        return CloseUp(target, replace(laid.scene, instances=[itself, *room], lights=lights))

    @staticmethod
    def _drawn_upright(rng: np.random.Generator, target: ObjectModel) -> CloseUp:
        if rng.random() < 0.15:
            return CloseUp._bare(rng, target)
        return CloseUp.on_table(rng, target).with_neighbours(rng, int(rng.integers(0, 5)))

    @staticmethod
    def on_table(rng: np.random.Generator, target: ObjectModel) -> CloseUp:
        """The object alone on a table."""
        bare = CloseUp._bare(rng, target)
        return bare._with(_table(rng, -target.extents[1] / 2))

    def with_neighbours(
        self, rng: np.random.Generator, count: int, categories: Sequence[str] = CATEGORIES
    ) -> CloseUp:
        """The same with `count` further objects standing about."""
        scene = self
        for _ in range(count):
            scene = scene._with(_neighbour(rng, scene, categories))
        return scene

    @staticmethod
    def _bare(rng: np.random.Generator, target: ObjectModel) -> CloseUp:
        red, green, blue = (int(c) for c in rng.integers(0, 256, 3))
        instances = [MeshInstance(target.mesh, np.eye(4), TARGET_ID)]
        return CloseUp(target, Scene(instances, _lights(rng), _ambient(rng), (red, green, blue)))

    def _with(self, instance: MeshInstance) -> CloseUp:
        return replace(self, scene=replace(self.scene, instances=[*self.scene.instances, instance]))

    def with_occluder(
        self, rng: np.random.Generator, T_cam_obj: Float[np.ndarray, "4 4"]
    ) -> CloseUp:
        """The same with a bar or a thing between this camera and the object."""
        camera_obj = invert_transform(T_cam_obj)[:3, 3]
        point_obj = (rng.random(3) - 0.5) * self.target.extents * 1.2
        place = point_obj + rng.uniform(0.25, 0.6) * (camera_obj - point_obj)
        mesh = pool_object(CATEGORIES[rng.integers(6)], int(rng.integers(_CLUTTER_POOL))).mesh
        size = rng.uniform(0.15, 0.5) * self.target.scale / np.linalg.norm(np.ptp(mesh.vertices, 0))
        stretched = mesh.vertices * size * rng.uniform(0.3, 1.6, 3)
        R = Rotation.random(rng=rng).as_matrix()
        occluder = TexturedMesh(stretched, mesh.faces, mesh.uv, mesh.texture, mesh.material)
        return self._with(MeshInstance(occluder, make_transform(R, place), OCCLUDER_ID))

    def render(
        self, T_cam_obj: Float[np.ndarray, "4 4"], K: Float[np.ndarray, "3 3"], size_px: int
    ) -> Rendering:
        """A noise-free square image; the object's id is TARGET_ID."""
        return render(self.scene, Camera(K, size_px, size_px, invert_transform(T_cam_obj)))


@dataclass(frozen=True)
class QuickSensor:
    """Errors of a small stereo camera's crop: the sensor model's main parts at little cost.

    σ_z = z² · `stereo` (a disparity error of about 0.1 px at 385 px · 50 mm), smooth over a few
    pixels; holes at grazing surfaces, depth edges and random places; 1 mm steps.
    """

    stereo: tuple[float, float] = (0.0008, 0.005)
    """Range of σ_z / z² [1/m]."""
    grain_px: tuple[float, float] = (0.7, 2.5)
    """Range of the noise's correlation length."""
    colorless_share: float = 0.15
    """Share of frames without colour."""

    def observe(self, rendering: Rendering, K: np.ndarray, rng: np.random.Generator) -> RgbdFrame:
        """A noisy frame."""
        depth = self._depth(rendering.depth, rng)
        has_color = bool(rng.random() >= self.colorless_share)
        rgb = _noisy_color(rendering.rgb, rng) if has_color else np.zeros_like(rendering.rgb)
        return RgbdFrame(rgb, depth, K, has_color=has_color)

    def _depth(
        self, depth: Float32[np.ndarray, "H W"], rng: np.random.Generator
    ) -> Float32[np.ndarray, "H W"]:
        height, width = depth.shape
        grain = rng.uniform(*self.grain_px)
        field = smooth_noise(height, width, grain, grain, rng)
        noisy = depth + depth**2 * rng.uniform(*self.stereo) * field
        noisy = np.round(noisy, 3)
        noisy[_holes(depth, rng)] = 0.0
        return noisy.astype(np.float32)


def _holes(depth: np.ndarray, rng: np.random.Generator) -> Bool[np.ndarray, "H W"]:
    step = np.maximum(
        np.abs(cv2.Sobel(depth, cv2.CV_32F, 1, 0)), np.abs(cv2.Sobel(depth, cv2.CV_32F, 0, 1))
    )
    height, width = depth.shape
    chance = rng.uniform(0.0, 0.9) * (step > rng.uniform(0.05, 0.2))
    holes = rng.random((height, width)) < chance
    if rng.random() < 0.5:
        grain = rng.uniform(2.0, 6.0)
        holes |= smooth_noise(height, width, grain, grain, rng) > rng.uniform(1.5, 3.0)
    return holes | (depth <= 0)


def _noisy_color(
    rgb: UInt8[np.ndarray, "H W 3"], rng: np.random.Generator
) -> UInt8[np.ndarray, "H W 3"]:
    balance = rng.uniform(0.55, 1.35) * rng.uniform(0.9, 1.1, 3)
    image = rgb * balance + rng.normal(0, rng.uniform(0.5, 6.0), rgb.shape)
    if rng.random() < 0.4:
        length = int(rng.integers(2, 7))
        kernel = np.zeros((7, 7), np.float32)
        angle = rng.uniform(0, np.pi)
        for step in np.linspace(-length / 2, length / 2, 15):
            kernel[int(3.5 + step * np.sin(angle)), int(3.5 + step * np.cos(angle))] += 1
        image = cv2.filter2D(image, -1, kernel / kernel.sum())
    return np.clip(image, 0, 255).astype(np.uint8)


@lru_cache(maxsize=4096)
def pool_object(category: str, seed: int) -> ObjectModel:
    """`make_object`, kept with what the renderer prepared for it (about 0.5 MB each)."""
    return make_object(category, seed)


def _neighbour(rng: np.random.Generator, scene: CloseUp, categories: Sequence[str]) -> MeshInstance:
    """A thing on the table, at the place of a few tried that is farthest from the other things."""
    target, taken = scene.target, [i.T_world_mesh[:3, 3] for i in scene.scene.instances[2:]]
    category = categories[int(rng.integers(len(categories)))]
    other = pool_object(category, int(rng.integers(_CLUTTER_POOL)))
    reach = (np.hypot(*target.extents[[0, 2]]) + np.hypot(*other.extents[[0, 2]])) / 2
    height = (other.extents[1] - target.extents[1]) / 2
    places = [_place_about(rng, reach, height) for _ in range(6 if taken else 1)]
    place = max(places, key=lambda p: min((np.linalg.norm(p - q) for q in taken), default=0.0))
    R = Rotation.from_euler("y", rng.uniform(0, 2 * np.pi)).as_matrix()
    number = TARGET_ID + len(scene.scene.instances)
    return MeshInstance(other.mesh, make_transform(R, place), number)


def _place_about(rng: np.random.Generator, reach: float, height: float) -> Float[np.ndarray, "3"]:
    azimuth = rng.uniform(0, 2 * np.pi)
    distance = reach * rng.uniform(0.75, 1.0) + rng.exponential(0.06)
    return np.array([distance * np.cos(azimuth), height, distance * np.sin(azimuth)])


def _table(rng: np.random.Generator, floor: float) -> MeshInstance:
    half = 1.0
    corners = np.array([[-half, 0, -half], [-half, 0, half], [half, 0, half], [half, 0, -half]])
    uv = corners[:, [0, 2]] / rng.uniform(0.2, 1.0)
    texture = any_pattern(rng, 96, 96)
    material = Material(float(rng.uniform(0, 0.3)), 20.0)
    mesh = TexturedMesh(corners, np.array([[0, 1, 2], [0, 2, 3]]), uv, texture, material)
    place = np.array([rng.uniform(-0.6, 0.6), floor, rng.uniform(-0.6, 0.6)])
    R = Rotation.from_euler("y", rng.uniform(0, 2 * np.pi)).as_matrix()
    return MeshInstance(mesh, make_transform(R, place), TARGET_ID + 1)


def _lights(rng: np.random.Generator) -> list[Light]:
    lights = []
    for _ in range(int(rng.integers(1, 4))):
        direction = rng.normal(size=3)
        direction[1] = -abs(direction[1]) - 0.2
        red, green, blue = (float(c) for c in rng.uniform(0.15, 0.8) * rng.uniform(0.8, 1.0, 3))
        lights.append(Light(direction / np.linalg.norm(direction), (red, green, blue)))
    return lights


def _ambient(rng: np.random.Generator) -> tuple[float, float, float]:
    level = float(rng.uniform(0.15, 0.6))
    return level, level, level
