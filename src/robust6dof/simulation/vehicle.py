"""The quadrotor as data: masses, rotors, limits; and its rotor mixer."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True)
class QuadrotorParameters:
    """A 0.5 m X-frame quadrotor able to lift a light arm. Body frame x forward, y left, z up."""

    mass: float = 1.85
    """Without the arm [kg]."""
    inertia: tuple[float, float, float] = (0.020, 0.020, 0.036)
    """Principal moments about the body axes, without the arm [kg m²]."""
    rotor_radius: float = 0.127
    """Ten-inch propellers [m]."""
    rotor_distance: float = 0.25
    """From the body's origin to each rotor's axis [m]."""
    rotor_height: float = 0.04
    """Of the rotor discs above the body's origin [m]."""
    max_thrust: float = 12.0
    """Of one rotor [N]."""
    yaw_moment: float = 0.016
    """Drag torque of a rotor for each newton of thrust [m]."""
    motor_time_constant: float = 0.03
    """First-order lag of a rotor's thrust [s]."""
    linear_drag: tuple[float, float, float] = (0.30, 0.30, 0.35)
    """Force opposing each body-axis component of the airspeed [N s/m]: rotor drag."""
    quadratic_drag: float = 0.03
    """Force opposing the airspeed, for each (m/s)² [N s²/m²]: the hull's drag."""

    @property
    def rotor_positions(self) -> Float[np.ndarray, "4 3"]:
        """Front right, rear left, front left, rear right, in the body frame [m]."""
        a = self.rotor_distance / np.sqrt(2.0)
        corners = [[a, -a], [-a, a], [a, a], [-a, -a]]
        return np.array([[x, y, self.rotor_height] for x, y in corners])

    @property
    def rotor_spins(self) -> Float[np.ndarray, "4"]:
        """+1 where the drag torque on the body is about +z (the rotor turns clockwise)."""
        return np.array([-1.0, -1.0, 1.0, 1.0])


@dataclass(frozen=True)
class Mixer:
    """From collective thrust and body torques to the four rotors' thrusts."""

    quadrotor: QuadrotorParameters = field(default_factory=QuadrotorParameters)

    @cached_property
    def allocation(self) -> Float[np.ndarray, "4 4"]:
        """Rows: collective thrust [N], torques about body x, y, z [N m]; columns: rotors."""
        x, y, _ = self.quadrotor.rotor_positions.T
        return np.stack([np.ones(4), y, -x, self.quadrotor.rotor_spins * self.quadrotor.yaw_moment])

    @cached_property
    def _columns(self) -> Float[np.ndarray, "4 4"]:
        return np.linalg.inv(self.allocation)

    def rotor_thrusts(
        self, thrust: float, torque: Float[np.ndarray, "3"]
    ) -> Float[np.ndarray, "4"]:
        """Thrust of each rotor [N] within its limits.

        Where the limits bind, yaw torque gives way first, then the collective thrust: roll and
        pitch keep the vehicle upright (the order of PX4's airmode).
        """
        limit = self.quadrotor.max_thrust
        tilting = self._columns[:, 1:3] @ torque[:2]
        tilting /= max(1.0, float(tilting.max() - tilting.min()) / limit)
        lowest, highest = -float(tilting.min()), limit - float(tilting.max())
        base = tilting + min(max(thrust / 4.0, lowest), highest)
        turning = self._columns[:, 3] * torque[2]
        room = np.where(turning > 0, limit - base, base)
        share = float(np.min(room / np.maximum(np.abs(turning), 1e-9)))
        thrusts = base + min(1.0, max(share, 0.0)) * turning
        return np.minimum(np.maximum(thrusts, 0.0), limit)
