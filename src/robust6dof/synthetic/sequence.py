"""A synthetic recording: one object among others, seen from a flying camera, and its truth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from robust6dof.frames import SYMMETRIC_CATEGORIES, RgbdFrame
from robust6dof.geometry.transforms import invert_transform
from robust6dof.rendering.d435i import color_camera
from robust6dof.rendering.rasteriser import render
from robust6dof.rendering.scene import Camera, Rendering
from robust6dof.rendering.sensor import StereoSensor, StereoSensorConfig
from robust6dof.shapes.mesh import ObjectModel
from robust6dof.synthetic.aerial_world import CARRIED_ID, TARGET_ID, AerialWorld
from robust6dof.synthetic.camera_motion import CameraMotion, twist_along
from robust6dof.synthetic.close_up import OCCLUDER_ID
from robust6dof.synthetic.difficulty import DIFFICULTIES
from robust6dof.synthetic.occluder import Occluder, draw_occluders
from robust6dof.synthetic.visibility import handle_visible, visible_surface, whole_silhouette

EXPOSURES_S = (0.004, 0.012)
"""Shortest and longest of a recording: indoor light [s]."""


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
    target_twist: Float[np.ndarray, "6"]
    """The same velocity relative to the target."""


@dataclass(frozen=True, eq=False)
class SyntheticSequence:
    """A recording of `len(self)` frames; frame i is made from the seed and i alone."""

    seed: int
    world: AerialWorld
    motion: CameraMotion
    occluders: tuple[Occluder, ...]
    sensor: StereoSensor
    exposure_s: float
    stamps: tuple[float, ...]
    """Of the frames that arrive [s]."""

    @staticmethod
    def draw(
        target: ObjectModel,
        difficulty: str,
        seed: int,
        frames: int = 120,
        rate_hz: float = 30.0,
        alike: Sequence[ObjectModel] = (),
    ) -> SyntheticSequence:
        """A sequence of the given difficulty.

        Args:
            target: the object to be tracked.
            difficulty: calm, agile or harsh.
            seed: of everything random.
            frames: taken; some are dropped on the way.
            rate_hz: of the camera.
            alike: objects to draw distractors of the target's category from; procedural ones if
                there are none.
        """
        rng = np.random.default_rng(seed)
        bounds = DIFFICULTIES[difficulty]
        duration = frames / rate_hz
        stamps = np.arange(frames) / rate_hz
        arrives = rng.random(frames) >= bounds.drop_share
        arrives[0] = True
        return SyntheticSequence(
            seed=seed,
            world=AerialWorld.draw(rng, target, bounds, duration, alike),
            motion=CameraMotion.draw(rng, bounds, duration),
            occluders=draw_occluders(rng, bounds, duration, target.scale),
            sensor=StereoSensor(StereoSensorConfig.d435i().drawn(rng)),
            exposure_s=float(rng.uniform(*EXPOSURES_S)),
            stamps=tuple(float(t) for t in stamps[arrives]),
        )

    def __len__(self) -> int:
        return len(self.stamps)

    def frame(self, index: int) -> tuple[RgbdFrame, FrameTruth]:
        """Render, measure and annotate one frame."""
        t = self.stamps[index]
        camera = color_camera(self.T_world_cam(t))
        T_cam_obj = invert_transform(camera.T_world_cam) @ self.world.T_world_obj(t)
        distance = float(T_cam_obj[2, 3])
        bar = next((bar for bar in self.occluders if bar.event.start < t < bar.event.end), None)
        twist, target_twist = self._twists(t)
        twists: dict[int, Float[np.ndarray, "6"]] = {}
        if self.world.moves:
            twists |= {TARGET_ID: target_twist, CARRIED_ID: target_twist}
        crossing = []
        if bar is not None:
            crossing = [bar.placed(t, camera.T_world_cam, distance)]
            twists[OCCLUDER_ID] = bar.camera_twist(distance)
        rendering = render(self.world.scene(t, *crossing), camera)
        frame = self.sensor.observe(
            rendering,
            camera,
            np.random.default_rng([self.seed, index]),
            camera_twist=twist,
            instance_twists=twists,
            exposure_s=self.exposure_s,
            stamp=t,
            name=f"{index:06d}",
        )
        return frame, self._truth(rendering, camera, T_cam_obj, (twist, target_twist))

    def T_world_cam(self, t: float) -> Float[np.ndarray, "4 4"]:
        """Where the camera is at time `t` [s]."""
        return self.motion.T_world_cam(t, self.world.T_world_obj(t)[:3, 3])

    def _twists(self, t: float) -> tuple[Float[np.ndarray, "6"], Float[np.ndarray, "6"]]:
        """The camera's velocity, in the world and relative to what moves with the target."""
        twist = twist_along(self.T_world_cam, t)
        if not self.world.moves:
            return twist, twist

        def T_carrier_cam(t: float) -> Float[np.ndarray, "4 4"]:
            return invert_transform(self.world.T_world_carrier(t)) @ self.T_world_cam(t)

        return twist, twist_along(T_carrier_cam, t)

    def _truth(
        self,
        rendering: Rendering,
        camera: Camera,
        T_cam_obj: Float[np.ndarray, "4 4"],
        twists: tuple[Float[np.ndarray, "6"], Float[np.ndarray, "6"]],
    ) -> FrameTruth:
        target = self.world.target.model
        mask = rendering.ids == TARGET_ID
        surface = visible_surface(rendering, TARGET_ID, camera.K, T_cam_obj)
        shows_handle = target.category != "mug" or handle_visible(surface, target.extents)
        return FrameTruth(
            T_cam_obj=T_cam_obj,
            extents=target.extents,
            mask=mask,
            visibility=float(mask.sum()) / max(whole_silhouette(target.mesh, T_cam_obj, camera), 1),
            handle_visible=shows_handle,
            symmetric=target.category in SYMMETRIC_CATEGORIES or not shows_handle,
            camera_twist=twists[0],
            target_twist=twists[1],
        )
