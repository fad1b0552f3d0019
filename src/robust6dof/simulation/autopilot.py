"""A flight controller like PX4's: velocity, attitude and rate loops in cascade.

It takes what PAD-Servo gives, a body-frame velocity and a yaw rate, and turns it into thrust and
torque. Roll and pitch are its own business: they follow from the acceleration it needs.

The demanded velocity is shaped first, as ArduCopter's guided mode does it: the loop follows a
first-order response to the demand, whose acceleration it knows and feeds forward, so that its
integrator answers to wind and drag alone.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float

GRAVITY = 9.81
"""[m/s²]"""


@dataclass(frozen=True)
class AutopilotConfig:
    """Gains of the three loops, each about three times faster than the one around it."""

    velocity_lag: float = 0.25
    """Time constant with which the velocity follows its demand [s]."""
    velocity_gain: tuple[float, float, float] = (3.5, 3.5, 4.0)
    """Acceleration for each m/s off that response, world axes [1/s]."""
    velocity_integral_gain: tuple[float, float, float] = (1.2, 1.2, 1.5)
    """[1/s²]"""
    max_acceleration: float = 4.0
    """Of the velocity loop's demand, per axis [m/s²]."""
    max_tilt: float = np.deg2rad(20.0)
    """Of the thrust axis [rad]."""
    attitude_gain: tuple[float, float, float] = (9.0, 9.0, 3.0)
    """Body rate for each radian of attitude error [1/s]."""
    max_rate: tuple[float, float, float] = (3.0, 3.0, 1.5)
    """Of the rate demand [rad/s]."""
    rate_gain: tuple[float, float, float] = (25.0, 25.0, 9.0)
    """Angular acceleration for each rad/s of rate error [1/s]."""
    rate_integral_gain: tuple[float, float, float] = (15.0, 15.0, 5.0)
    """[1/s²]"""
    max_yaw_lead: float = 0.4
    """How far the yaw set-point may run ahead of the yaw [rad]."""


@dataclass(frozen=True, eq=False)
class AutopilotState:
    """The loops' integrators."""

    yaw: float
    """Yaw set-point [rad]."""
    velocity: Float[np.ndarray, "3"] = field(default_factory=lambda: np.zeros(3))
    """Where the velocity should be by now, world axes [m/s]."""
    acceleration: Float[np.ndarray, "3"] = field(default_factory=lambda: np.zeros(3))
    """Integral part of the velocity loop, world axes [m/s²]."""
    angular_acceleration: Float[np.ndarray, "3"] = field(default_factory=lambda: np.zeros(3))
    """Integral part of the rate loop, body axes [rad/s²]."""


@dataclass(frozen=True, eq=False)
class VehicleEstimate:
    """What the flight controller's own estimator believes (noise included)."""

    R_world_body: Float[np.ndarray, "3 3"]
    velocity_world: Float[np.ndarray, "3"]
    """[m/s]"""
    rates_body: Float[np.ndarray, "3"]
    """The gyroscope's angular velocity about the body axes [rad/s]."""

    @property
    def yaw(self) -> float:
        """Heading [rad]."""
        return float(np.arctan2(self.R_world_body[1, 0], self.R_world_body[0, 0]))


@dataclass(frozen=True, eq=False)
class MassModel:
    """What the controller knows of the loaded vehicle, for its feed-forward."""

    mass: float
    """Arm included [kg]."""
    inertia: Float[np.ndarray, "3"]
    """About the body axes with the arm in its home posture [kg m²]."""


@dataclass(frozen=True, eq=False)
class Autopilot:
    """The cascade. Pure: the state goes in and comes out."""

    mass_model: MassModel
    config: AutopilotConfig = field(default_factory=AutopilotConfig)

    @cached_property
    def _gains(self) -> dict[str, Float[np.ndarray, "3"]]:
        """The configuration's triples as arrays, by name."""
        return {k: np.array(v) for k, v in vars(self.config).items() if isinstance(v, tuple)}

    def step(
        self,
        state: AutopilotState,
        estimate: VehicleEstimate,
        velocity_body: Float[np.ndarray, "3"],
        yaw_rate: float,
        center_of_mass: Float[np.ndarray, "3"],
        dt: float,
    ) -> tuple[AutopilotState, float, Float[np.ndarray, "3"]]:
        """One cycle.

        Args:
            velocity_body: demanded velocity of the body's origin in body axes [m/s].
            yaw_rate: demanded [rad/s].
            center_of_mass: of vehicle and arm in the body frame [m], from the joint angles; the
                shift of mass is fed forward as the torque that balances it.
            dt: [s].

        Returns:
            the next state, collective thrust [N], torque about the body's origin [N m].
        """
        state, acceleration = self._velocity_loop(state, estimate, velocity_body, dt)
        state = self._turn_yaw(state, estimate, yaw_rate, dt)
        thrust_world = self._limit_tilt(acceleration) * self.mass_model.mass
        thrust = max(0.0, float(thrust_world @ estimate.R_world_body[:, 2]))
        rates = self._attitude_loop(estimate, thrust_world, state.yaw, yaw_rate)
        state, torque = self._rate_loop(state, estimate, rates, dt)
        balance = np.array([center_of_mass[1] * thrust, -center_of_mass[0] * thrust, 0.0])
        return state, thrust, torque + balance

    def _velocity_loop(
        self,
        state: AutopilotState,
        estimate: VehicleEstimate,
        velocity_body: Float[np.ndarray, "3"],
        dt: float,
    ) -> tuple[AutopilotState, Float[np.ndarray, "3"]]:
        limit = self.config.max_acceleration
        off = estimate.R_world_body @ velocity_body - state.velocity
        planned = _clip(off / self.config.velocity_lag, -limit, limit)
        velocity = state.velocity + planned * dt
        error = velocity - estimate.velocity_world
        integral = state.acceleration + self._gains["velocity_integral_gain"] * error * dt
        integral = _clip(integral, -limit, limit)
        demand = planned + self._gains["velocity_gain"] * error + integral
        state = replace(state, velocity=velocity, acceleration=integral)
        return state, _clip(demand, -limit, limit)

    def _turn_yaw(
        self, state: AutopilotState, estimate: VehicleEstimate, yaw_rate: float, dt: float
    ) -> AutopilotState:
        lead = _wrap(state.yaw + yaw_rate * dt - estimate.yaw)
        lead = min(max(lead, -self.config.max_yaw_lead), self.config.max_yaw_lead)
        return replace(state, yaw=estimate.yaw + lead)

    def _limit_tilt(self, acceleration: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
        """Specific thrust [m/s²] for an acceleration, within the tilt limit; climbing first."""
        up = max(acceleration[2] + GRAVITY, 0.3 * GRAVITY)
        sideways = float(np.hypot(acceleration[0], acceleration[1]))
        share = min(1.0, up * np.tan(self.config.max_tilt) / max(sideways, 1e-9))
        return np.array([share * acceleration[0], share * acceleration[1], up])

    def _attitude_loop(
        self,
        estimate: VehicleEstimate,
        thrust_world: Float[np.ndarray, "3"],
        yaw: float,
        yaw_rate: float,
    ) -> Float[np.ndarray, "3"]:
        R = estimate.R_world_body.T @ _attitude(thrust_world, yaw)
        # sin θ times the axis: as good as θ here, tilt and yaw lead are limited.
        error = 0.5 * np.array([R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1]])
        limit = self._gains["max_rate"]
        demand = self._gains["attitude_gain"] * error
        demand[2] += yaw_rate
        return _clip(demand, -limit, limit)

    def _rate_loop(
        self,
        state: AutopilotState,
        estimate: VehicleEstimate,
        rates: Float[np.ndarray, "3"],
        dt: float,
    ) -> tuple[AutopilotState, Float[np.ndarray, "3"]]:
        error = rates - estimate.rates_body
        integral = state.angular_acceleration
        integral = integral + self._gains["rate_integral_gain"] * error * dt
        integral = _clip(integral, -10.0, 10.0)
        demand = self._gains["rate_gain"] * error + integral
        state = replace(state, angular_acceleration=integral)
        return state, self.mass_model.inertia * demand


def _attitude(thrust_world: Float[np.ndarray, "3"], yaw: float) -> Float[np.ndarray, "3 3"]:
    """R_world_body whose z is along the thrust and whose heading is `yaw`."""
    # Written out: numpy's cross product takes longer than all the rest of the controller.
    z1, z2, z3 = thrust_world / np.sqrt(thrust_world @ thrust_world)
    c, s = np.cos(yaw), np.sin(yaw)
    y = np.array([-z3 * s, z3 * c, z1 * s - z2 * c])
    y1, y2, y3 = y / np.sqrt(y @ y)
    x1, x2, x3 = y2 * z3 - y3 * z2, y3 * z1 - y1 * z3, y1 * z2 - y2 * z1
    return np.array([[x1, y1, z1], [x2, y2, z2], [x3, y3, z3]])


def _clip(
    values: Float[np.ndarray, "3"],
    low: float | Float[np.ndarray, "3"],
    high: float | Float[np.ndarray, "3"],
) -> Float[np.ndarray, "3"]:
    # A third of the time that np.clip takes, which is called six times in 5 ms.
    return np.minimum(np.maximum(values, low), high)


def _wrap(angle: float) -> float:
    return float((angle + np.pi) % (2.0 * np.pi) - np.pi)
