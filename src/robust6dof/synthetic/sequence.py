"""A synthetic recording: one object among others, seen from a flying camera, and its truth."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import Rotation

from robust6dof.frames import SYMMETRIC_CATEGORIES, RgbdFrame
from robust6dof.geometry.transforms import invert_transform, make_transform
from robust6dof.rendering.rasteriser import render, render_depth
from robust6dof.rendering.scene import Camera, MeshInstance, Rendering, Scene
from robust6dof.rendering.sensor import StereoSensor, StereoSensorConfig
from robust6dof.shapes.mesh import ObjectModel
from robust6dof.synthetic.camera_motion import CameraMotion
from robust6dof.synthetic.close_up import TARGET_ID, CloseUp, pool_object
from robust6dof.synthetic.difficulty import DIFFICULTIES, Difficulty
from robust6dof.synthetic.signals import Event, draw_events
from robust6dof.synthetic.target_motion import MOVING_PATHS, TargetMotion
from robust6dof.synthetic.visibility import handle_visible, visible_surface

WIDTH, HEIGHT = 640, 480
K_D435I = np.array([[615.0, 0.0, 319.5], [0.0, 615.0, 239.5], [0.0, 0.0, 1.0]])
"""Colour camera of a RealSense D435i at 640×480; depth is registered to it."""
OCCLUDER_ID = 99
R_WORLD_OBJ = Rotation.from_euler("x", 90, degrees=True).as_matrix()
"""The object stands upright: its y is the world's z."""


@dataclass(frozen=True, eq=False)
class FrameTruth:
    """What is true of the target in one frame."""

    T_cam_obj: Float[np.ndarray, "4 4"]
    extents: Float[np.ndarray, "3"]
    mask: Bool[np.ndarray, "H W"]
    visibility: float
    """Share of the whole silhouette, that outside the image counted in, which is in view."""
    handle_visible: bool
    symmetric: bool
    camera_twist: Float[np.ndarray, "6"]
    """Linear and angular velocity of the camera in its own frame [m/s, rad/s]."""


@dataclass(frozen=True, eq=False)
class Occluder:
    """A bar that crosses the line of sight while its event lasts."""

    event: Event
    instance: MeshInstance
    direction: float
    """In which it crosses the image [rad]."""

    def placed(self, t: float, T_world_cam: np.ndarray, distance: float) -> MeshInstance | None:
        """The bar at time `t`, half-way to the object; None while it is away."""
        if not self.event.start < t < self.event.end:
            return None
        progress = (t - self.event.start) / (self.event.end - self.event.start)
        offset = (2 * progress - 1) * 0.35 * distance
        centre = [offset * np.cos(self.direction), offset * np.sin(self.direction), distance / 2]
        R = Rotation.from_euler("z", self.direction).as_matrix()
        T_cam_bar = make_transform(R, np.array(centre))
        return replace(self.instance, T_world_mesh=T_world_cam @ T_cam_bar)


@dataclass(frozen=True, eq=False)
class SyntheticSequence:
    """A recording of `len(self)` frames; frame i is made from the seed and i alone."""

    target: ObjectModel
    difficulty: Difficulty
    seed: int
    close_up: CloseUp
    motion: CameraMotion
    carrier: TargetMotion
    occluders: tuple[Occluder, ...]
    sensor: StereoSensor
    stamps: tuple[float, ...]
    """Of the frames that arrive [s]."""

    @staticmethod
    def draw(
        target: ObjectModel, difficulty: str, seed: int, frames: int = 120, rate_hz: float = 30.0
    ) -> SyntheticSequence:
        """A sequence of the given difficulty.

        Args:
            target: the object to be tracked.
            difficulty: calm, agile or harsh.
            seed: of everything random.
            frames: taken; some are dropped on the way.
            rate_hz: of the camera.
        """
        rng = np.random.default_rng(seed)
        bounds = DIFFICULTIES[difficulty]
        duration = frames / rate_hz
        moving = rng.random() < bounds.moving_share
        path = MOVING_PATHS[int(rng.integers(len(MOVING_PATHS)))] if moving else "fixed"
        stamps = np.arange(frames) / rate_hz
        arrives = rng.random(frames) >= bounds.drop_share
        arrives[0] = True
        return SyntheticSequence(
            target=target,
            difficulty=bounds,
            seed=seed,
            close_up=_with_neighbours(rng, CloseUp.on_table(rng, target), bounds),
            motion=CameraMotion.draw(rng, bounds, duration),
            carrier=TargetMotion.draw(rng, path, bounds.target_speed),
            occluders=_draw_occluders(rng, bounds, duration, target.scale),
            sensor=StereoSensor(StereoSensorConfig.d435i().drawn(rng)),
            stamps=tuple(float(t) for t in stamps[arrives]),
        )

    def __len__(self) -> int:
        return len(self.stamps)

    def frame(self, index: int) -> tuple[RgbdFrame, FrameTruth]:
        """Render, measure and annotate one frame."""
        t = self.stamps[index]
        T_world_cam, T_world_obj, twist = self._place(t)
        T_cam_obj = invert_transform(T_world_cam) @ T_world_obj
        camera = Camera(K_D435I, WIDTH, HEIGHT, invert_transform(T_cam_obj))
        scene = self._scene(t, camera.T_world_cam, float(T_cam_obj[2, 3]))
        rendering = render(scene, camera)
        rng = np.random.default_rng([self.seed, index])
        frame = self.sensor.observe(
            rendering, camera, rng, camera_twist=twist, stamp=t, name=f"{index:06d}"
        )
        return frame, self._truth(rendering, camera, T_cam_obj, twist)

    def _place(self, t: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """T_world_cam, T_world_obj and the camera's velocity relative to the object's frame."""
        x, y, turn = self.carrier.place(t)
        place = np.array([x, y, 0.0])
        velocity = self.carrier.velocity_world(t)
        R_carrier = Rotation.from_euler("z", turn).as_matrix()
        return (
            self.motion.T_world_cam(t, place),
            make_transform(R_carrier @ R_WORLD_OBJ, place),
            self.motion.twist_cam(t, place, velocity),
        )

    def _scene(self, t: float, T_obj_cam: np.ndarray, distance: float) -> Scene:
        """The scene in the object's frame; occluders stand before the camera."""
        bars = [bar.placed(t, T_obj_cam, distance) for bar in self.occluders]
        scene = self.close_up.scene
        instances = [*scene.instances, *(bar for bar in bars if bar is not None)]
        return replace(scene, instances=instances)

    def _truth(
        self, rendering: Rendering, camera: Camera, T_cam_obj: np.ndarray, twist: np.ndarray
    ) -> FrameTruth:
        mask = rendering.ids == TARGET_ID
        surface = visible_surface(rendering, TARGET_ID, camera.K, T_cam_obj)
        shows_handle = self.target.category != "mug" or handle_visible(surface, self.target.extents)
        return FrameTruth(
            T_cam_obj=T_cam_obj,
            extents=self.target.extents,
            mask=mask,
            visibility=float(mask.sum()) / max(self._whole_silhouette(camera), 1),
            handle_visible=shows_handle,
            symmetric=self.target.category in SYMMETRIC_CATEGORIES or not shows_handle,
            camera_twist=twist,
        )

    def _whole_silhouette(self, camera: Camera) -> int:
        """Pixels that the object alone would cover in an image three times as wide and high."""
        K = camera.K.copy()
        K[0, 2] += camera.width
        K[1, 2] += camera.height
        wide = Camera(K, 3 * camera.width, 3 * camera.height, camera.T_world_cam)
        alone = Scene([MeshInstance(self.target.mesh, np.eye(4), TARGET_ID)])
        return int((render_depth(alone, wide)[1] == TARGET_ID).sum())


def _with_neighbours(rng: np.random.Generator, close_up: CloseUp, bounds: Difficulty) -> CloseUp:
    others = int(rng.integers(bounds.clutter[0], bounds.clutter[1] + 1))
    alike = int(rng.integers(bounds.distractors[0], bounds.distractors[1] + 1))
    return close_up.with_neighbours(rng, others).with_neighbours(
        rng, alike, categories=(close_up.target.category,)
    )


def _draw_occluders(
    rng: np.random.Generator, bounds: Difficulty, duration: float, scale: float
) -> tuple[Occluder, ...]:
    events = draw_events(
        rng, duration, bounds.occlusion_period, rise=(0.1, 0.2), hold=(0.3, 1.2), quiet=1.0
    )
    return tuple(_draw_bar(rng, event, scale) for event in events)


def _draw_bar(rng: np.random.Generator, event: Event, scale: float) -> Occluder:
    """A thing stretched to a bar as wide as a part of the object looks, half-way to it."""
    thing = pool_object("can", int(rng.integers(40))).mesh
    size = np.ptp(thing.vertices, axis=0)
    width = rng.uniform(0.15, 0.35) * scale
    stretched = thing.vertices / size * np.array([width, 0.8, width])
    instance = MeshInstance(replace(thing, vertices=stretched), np.eye(4), OCCLUDER_ID)
    return Occluder(event, instance, float(rng.uniform(0, 2 * np.pi)))
