"""Where the target stands: fixed, or carried by a ground vehicle."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float

PathName = Literal["fixed", "straight", "circle", "stop-and-go"]
MOVING_PATHS: tuple[PathName, ...] = ("straight", "circle", "stop-and-go")


@dataclass(frozen=True)
class TargetMotion:
    """Planar motion of the target's carrier: place (x, y) [m] and heading [rad] over time.

    It starts at the origin with zero heading offset and, on a circle, comes back to it.
    """

    path: PathName = "fixed"
    speed: float = 0.0
    """Along the path; for stop-and-go at its fastest [m/s]."""
    direction: float = 0.0
    """Initial direction of travel [rad]."""
    radius: float = 0.6
    """Of the circle [m]."""
    period: float = 6.0
    """Of stop-and-go and of the straight path's turning back [s]."""

    @staticmethod
    def draw(rng: np.random.Generator, path: PathName, speed: float) -> TargetMotion:
        """A motion on the given path with random direction and size."""
        return TargetMotion(
            path=path,
            speed=speed,
            direction=rng.uniform(0, 2 * np.pi),
            radius=rng.uniform(0.4, 0.9),
            period=rng.uniform(4.0, 8.0),
        )

    def place(self, t: float) -> tuple[float, float, float]:
        """x, y [m] and turn about the vertical [rad] since the start, at time `t` [s]."""
        if self.path == "circle":
            angle = self.speed * t / self.radius
            forward, left = self.radius * np.sin(angle), self.radius * (1 - np.cos(angle))
            return (*self._rotate(forward, left), angle)
        if self.path == "fixed":
            return 0.0, 0.0, 0.0
        return (*self._rotate(self._travelled(t), 0.0), 0.0)

    def velocity_world(self, t: float) -> Float[np.ndarray, "3"]:
        """Linear velocity [m/s] at time `t` [s]."""
        step = 1e-4
        after, before = self.place(t + step), self.place(t - step)
        return np.array([after[0] - before[0], after[1] - before[1], 0.0]) / (2 * step)

    def _travelled(self, t: float) -> float:
        phase = 2 * np.pi * t / self.period
        if self.path == "straight":
            # Forth and back, so that long runs stay on the floor that is drawn.
            return self.speed * self.period / (2 * np.pi) * float(np.sin(phase))
        # Speed v (1 − cos φ)/2: from rest to v and back to rest each period.
        return 0.5 * self.speed * (t - self.period / (2 * np.pi) * float(np.sin(phase)))

    def _rotate(self, forward: float, left: float) -> tuple[float, float]:
        c, s = np.cos(self.direction), np.sin(self.direction)
        return float(c * forward - s * left), float(s * forward + c * left)
