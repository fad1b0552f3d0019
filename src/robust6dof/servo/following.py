"""Commands for a vehicle that follows them late.

The law says which velocity the vehicle should have now. A real velocity loop gets there with a
lag T, so what is commanded is what will be wanted T later; and what the vehicle has nevertheless
fallen short of, by its own odometry, is made up for. Neither touches the law: a vehicle that
follows at once gets the law's own velocity.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from robust6dof.servo.config import PadServoConfig


@dataclass(frozen=True, eq=False)
class Following:
    """What the vehicle was to do and how far it is behind; body axes. Immutable."""

    wanted: Float[np.ndarray, "3"]
    """Velocity since the last step [m/s]."""
    shortfall: Float[np.ndarray, "3"]
    """How far the vehicle is behind all that was wanted [m]."""

    @classmethod
    def none(cls) -> Following:
        """Nothing wanted yet."""
        return cls(np.zeros(3), np.zeros(3))

    def moved(
        self, velocity: Float[np.ndarray, "3"], yaw_rate: float, dt: float, limit: float
    ) -> Following:
        """After the vehicle flew with a mean `velocity` [m/s] for `dt` [s].

        Args:
            limit: no more than this is remembered [m].
        """
        shortfall = self.shortfall + (self.wanted - velocity) * dt
        shortfall = shortfall - dt * yaw_rate * _turned(shortfall)  # the axes turn under it
        size = float(np.linalg.norm(shortfall))
        return replace(self, shortfall=shortfall * min(1.0, limit / max(size, 1e-9)))

    def command(
        self,
        wanted: Float[np.ndarray, "3"],
        target_velocity: Float[np.ndarray, "3"],
        target_acceleration: Float[np.ndarray, "3"],
        yaw_rate: float,
        config: PadServoConfig,
    ) -> Float[np.ndarray, "3"]:
        """v + T v̇ + k · shortfall, all in body axes [m/s].

        v̇ over ground is the target's own acceleration, and the rest of the velocity turning
        with the vehicle.
        """
        change = target_acceleration + yaw_rate * _turned(wanted - target_velocity)
        return wanted + config.vehicle_lag * change + config.shortfall_gain * self.shortfall


def _turned(v: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
    """z × v."""
    return np.array([-v[1], v[0], 0.0])
