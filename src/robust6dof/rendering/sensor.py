"""What an Intel RealSense D435i makes of an exact rendering: noisy depth and colour.

`docs/sensor-model.md` lists every effect with its formula and source.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from jaxtyping import Float

from robust6dof.errors import InputError
from robust6dof.frames import RgbdFrame
from robust6dof.rendering.color_model import STILL, observe_color
from robust6dof.rendering.depth_model import observe_depth
from robust6dof.rendering.scene import Camera, Rendering
from robust6dof.rendering.sensor_config import StereoSensorConfig

__all__ = ["StereoSensor", "StereoSensorConfig"]


class StereoSensor:
    """Turns renderings into the frames a real camera would give."""

    def __init__(self, config: StereoSensorConfig | None = None) -> None:
        self.config = StereoSensorConfig.d435i() if config is None else config

    def observe(
        self,
        rendering: Rendering,
        camera: Camera,
        rng: np.random.Generator,
        *,
        camera_twist: Float[np.ndarray, "6"] | None = None,
        instance_twists: Mapping[int, Float[np.ndarray, "6"]] | None = None,
        exposure_s: float = 0.008,
        stamp: float | None = None,
        name: str = "",
    ) -> RgbdFrame:
        """Measure one frame; the same generator state gives the same bytes.

        Args:
            rendering: the scene at the middle of the exposure.
            camera: the camera it was rendered with.
            rng: where all randomness comes from.
            camera_twist: velocity of the camera in its own frame, linear [m/s] then angular
                [rad/s]; blurs the colour. None: at rest.
            instance_twists: by `instance_id`, the same velocity relative to things that move.
            exposure_s: how long the colour shutter is open.
            stamp: time of the frame [s].
            name: name of the frame.

        Raises:
            InputError: a negative exposure or a rendering of another size than the camera's.
        """
        if rendering.depth.shape != (camera.height, camera.width):
            raise InputError("the rendering is not of the camera's size")
        if exposure_s < 0:
            raise InputError(f"the exposure must not be negative, got {exposure_s} s")
        depth = observe_depth(rendering, camera.K, self.config, rng)
        twists = dict(instance_twists or {})
        if camera_twist is not None or twists:
            twists[STILL] = np.zeros(6) if camera_twist is None else camera_twist
        rgb = observe_color(rendering, camera.K, self.config, rng, twists, exposure_s)
        return RgbdFrame(rgb, depth, camera.K, stamp, name)
