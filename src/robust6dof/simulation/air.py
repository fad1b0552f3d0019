"""What the air does: gusts, drag, ground effect."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from robust6dof.simulation.vehicle import QuadrotorParameters


@dataclass(frozen=True)
class WindConfig:
    """Mean wind and turbulence."""

    mean: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """World axes [m/s]."""
    turbulence: tuple[float, float, float] = (0.10, 0.10, 0.05)
    """Standard deviation of each component [m/s]; the default is a draught in a room."""
    correlation_time: float = 1.5
    """Of the turbulence [s]: the length scale over the mean airspeed in Dryden's model."""
    gust: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Peak of a single discrete gust, world axes [m/s]."""
    gust_start: float = 8.0
    """[s]"""
    gust_duration: float = 4.0
    """[s]"""


@dataclass(frozen=True, eq=False)
class Wind:
    """Turbulence as Dryden's longitudinal filter on every axis, plus one (1 − cos) gust."""

    config: WindConfig

    def start(self, rng: np.random.Generator) -> Float[np.ndarray, "3"]:
        """Turbulence [m/s] drawn from its stationary distribution."""
        return np.array(self.config.turbulence) * rng.standard_normal(3)

    def step(
        self, turbulence: Float[np.ndarray, "3"], dt: float, rng: np.random.Generator
    ) -> Float[np.ndarray, "3"]:
        """The exact discretisation of σ √(2/τ) / (s + 1/τ) driven by white noise."""
        keep = np.exp(-dt / self.config.correlation_time)
        noise = np.array(self.config.turbulence) * rng.standard_normal(3)
        return keep * turbulence + np.sqrt(1.0 - keep**2) * noise

    def velocity(self, turbulence: Float[np.ndarray, "3"], time: float) -> Float[np.ndarray, "3"]:
        """Velocity of the air, world axes [m/s]."""
        phase = (time - self.config.gust_start) / self.config.gust_duration
        share = 0.5 * (1.0 - np.cos(2.0 * np.pi * phase)) if 0.0 < phase < 1.0 else 0.0
        return np.array(self.config.mean) + turbulence + share * np.array(self.config.gust)


def drag_force(
    quadrotor: QuadrotorParameters,
    airspeed_world: Float[np.ndarray, "3"],
    R_world_body: Float[np.ndarray, "3 3"],
) -> Float[np.ndarray, "3"]:
    """Drag on the vehicle, world axes [N]; `airspeed_world` is the vehicle's minus the air's."""
    rotors = R_world_body @ (np.array(quadrotor.linear_drag) * (R_world_body.T @ airspeed_world))
    speed = float(np.sqrt(airspeed_world @ airspeed_world))
    return -rotors - quadrotor.quadratic_drag * speed * airspeed_world


def ground_effect(
    quadrotor: QuadrotorParameters, height: Float[np.ndarray, "R"]
) -> Float[np.ndarray, "R"]:
    """Factor on a rotor's thrust at `height` [m] above a surface.

    1 / (1 − (r/4h)²), the classical result for one rotor (Cheeseman and Bennett, 1955); held
    below half a radius, where it ceases to hold.
    """
    ratio = quadrotor.rotor_radius / (4.0 * np.maximum(height, 0.5 * quadrotor.rotor_radius))
    return 1.0 / (1.0 - ratio**2)
