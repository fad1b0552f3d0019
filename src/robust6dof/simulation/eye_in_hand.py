"""The RGB-D camera on the arm: a RealSense D435i's colour camera, its depth registered to it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from robust6dof.frames import RgbdFrame
from robust6dof.rendering.d435i import color_camera
from robust6dof.rendering.rasteriser import render
from robust6dof.rendering.sensor import StereoSensor, StereoSensorConfig
from robust6dof.robot.aerial_manipulator import AerialManipulator
from robust6dof.simulation.episode import TARGET_ID, VEHICLE_ID, Episode
from robust6dof.simulation.plant import VehicleState
from robust6dof.simulation.vehicle import QuadrotorParameters
from robust6dof.simulation.vehicle_look import VehicleLook

EXPOSURE = 0.008
"""Of an image in room light [s]."""


@dataclass(frozen=True, eq=False)
class Exposure:
    """One image and, for the start and the judges only, what is true in it."""

    frame: RgbdFrame
    mask: Bool[np.ndarray, "H W"]
    """True silhouette of the target; a tracker may see that of the first frame only."""


class EyeInHand:
    """The camera of one episode: its own unit of the sensor, its own noise.

    The image's blur is that of the camera's true motion during the exposure.
    """

    def __init__(
        self,
        episode: Episode,
        manipulator: AerialManipulator,
        quadrotor: QuadrotorParameters,
        sensor: StereoSensorConfig | None = None,
    ) -> None:
        self._world, self._manipulator = episode.world, manipulator
        self._look = VehicleLook.build(manipulator, quadrotor)
        self._rng = np.random.default_rng([episode.seed, 4])
        drawn = StereoSensorConfig.d435i().drawn(self._rng) if sensor is None else sensor
        self._sensor = StereoSensor(drawn)

    def expose(self, state: VehicleState) -> Exposure:
        """Take an image."""
        camera = color_camera(state.T_world_cam)
        vehicle = self._look.instances(state.T_world_body, state.joints, VEHICLE_ID)
        rendering = render(self._world.scene(state.time, *vehicle), camera)
        frame = self._sensor.observe(
            rendering,
            camera,
            self._rng,
            camera_twist=self._twist(state),
            exposure_s=EXPOSURE,
            stamp=state.time,
        )
        return Exposure(frame, rendering.ids == TARGET_ID)

    def _twist(self, state: VehicleState) -> Float[np.ndarray, "6"]:
        motion = np.concatenate([state.velocity_body, state.rates_body, state.joint_rates])
        return self._manipulator.camera_jacobian(state.joints) @ motion
