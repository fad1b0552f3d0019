"""Things that cross the line of sight of an aerial recording."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from robust6dof.geometry.transforms import make_transform
from robust6dof.rendering.scene import MeshInstance
from robust6dof.synthetic.close_up import OCCLUDER_ID, pool_object
from robust6dof.synthetic.difficulty import Difficulty
from robust6dof.synthetic.signals import Event, draw_events

_SWEEP = 0.7
"""Its way across the image, as a share of the distance to the object."""


@dataclass(frozen=True, eq=False)
class Occluder:
    """A bar that crosses the line of sight while its event lasts."""

    event: Event
    instance: MeshInstance
    direction: float
    """In which it crosses the image [rad]."""

    def placed(
        self, t: float, T_world_cam: Float[np.ndarray, "4 4"], distance: float
    ) -> MeshInstance:
        """The bar at time `t` of its event, half-way to an object `distance` metres away."""
        progress = (t - self.event.start) / (self.event.end - self.event.start)
        across = (progress - 0.5) * _SWEEP * distance * self._heading()
        R = Rotation.from_euler("z", self.direction).as_matrix()
        T_cam_bar = make_transform(R, across + [0.0, 0.0, distance / 2])
        return replace(self.instance, T_world_mesh=T_world_cam @ T_cam_bar)

    def camera_twist(self, distance: float) -> Float[np.ndarray, "6"]:
        """Velocity of the camera relative to the bar [m/s, rad/s]."""
        speed = _SWEEP * distance / (self.event.end - self.event.start)
        return np.concatenate([-speed * self._heading(), np.zeros(3)])

    def _heading(self) -> Float[np.ndarray, "3"]:
        return np.array([np.cos(self.direction), np.sin(self.direction), 0.0])


def draw_occluders(
    rng: np.random.Generator, bounds: Difficulty, duration: float, scale: float
) -> tuple[Occluder, ...]:
    """Those of one recording, one after another.

    Args:
        rng: where all randomness comes from.
        bounds: the difficulty.
        duration: of the recording [s].
        scale: the target's diagonal [m]; bars are as wide as a part of it.
    """
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
