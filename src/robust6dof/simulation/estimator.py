"""IMU-grade state noise: what the flight controller believes is not what is."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from robust6dof.simulation.autopilot import VehicleEstimate


@dataclass(frozen=True)
class EstimatorNoise:
    """Standard deviations. Zero everywhere gives the truth (`EstimatorNoise.none()`)."""

    gyro: float = 0.006
    """White, per sample [rad/s]: a consumer MEMS gyroscope at 250 Hz."""
    gyro_bias: float = 0.002
    """Constant through a run [rad/s]."""
    attitude: float = np.deg2rad(0.1)
    """Slowly varying, about each axis [rad]."""
    attitude_time: float = 8.0
    """Its correlation time [s]."""
    velocity: float = 0.004
    """Slowly varying, per axis [m/s]: visual-inertial or motion-capture aided."""
    velocity_time: float = 3.0
    """Its correlation time [s]."""
    velocity_white: float = 0.006
    """White, per sample [m/s]."""
    height: float = 0.02
    """White, per reading [m]: a range finder's."""
    encoder_counts: int = 4096
    """Of a joint's encoder on a full turn; 0 for exact angles."""

    @staticmethod
    def none() -> EstimatorNoise:
        """Exact knowledge."""
        return EstimatorNoise(0.0, 0.0, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0, 0)


@dataclass(frozen=True, eq=False)
class EstimatorState:
    """The slow errors."""

    gyro_bias: Float[np.ndarray, "3"]
    attitude_error: Float[np.ndarray, "3"]
    velocity_error: Float[np.ndarray, "3"]


@dataclass(frozen=True, eq=False)
class StateEstimator:
    """Adds the noise of an inertial estimator to the truth."""

    noise: EstimatorNoise

    def start(self, rng: np.random.Generator) -> EstimatorState:
        """Slow errors drawn from their stationary distribution."""
        sigmas = (self.noise.gyro_bias, self.noise.attitude, self.noise.velocity)
        return EstimatorState(*(sigma * rng.standard_normal(3) for sigma in sigmas))

    def step(self, state: EstimatorState, dt: float, rng: np.random.Generator) -> EstimatorState:
        """Let the slow errors wander (first-order Gauss–Markov, exact in `dt`)."""
        noise = self.noise
        attitude = _wander(state.attitude_error, noise.attitude, dt / noise.attitude_time, rng)
        velocity = _wander(state.velocity_error, noise.velocity, dt / noise.velocity_time, rng)
        return replace(state, attitude_error=attitude, velocity_error=velocity)

    def observe(
        self,
        state: EstimatorState,
        R_world_body: Float[np.ndarray, "3 3"],
        velocity_world: Float[np.ndarray, "3"],
        rates_body: Float[np.ndarray, "3"],
        rng: np.random.Generator,
    ) -> VehicleEstimate:
        """The estimate for a true state."""
        white = rng.standard_normal((2, 3))
        a, b, c = state.attitude_error
        # A rotation to first order: the error is a tenth of a degree.
        R_error = np.array([[1.0, -c, b], [c, 1.0, -a], [-b, a, 1.0]])
        return VehicleEstimate(
            R_world_body=R_error @ R_world_body,
            velocity_world=velocity_world
            + state.velocity_error
            + self.noise.velocity_white * white[0],
            rates_body=rates_body + state.gyro_bias + self.noise.gyro * white[1],
        )

    def read_height(self, height: float, rng: np.random.Generator) -> float:
        """Height above the floor [m]."""
        return height + self.noise.height * float(rng.standard_normal())

    def read_encoders(self, joints: Float[np.ndarray, "J"]) -> Float[np.ndarray, "J"]:
        """Joint angles [rad] rounded to the encoder's counts."""
        if self.noise.encoder_counts == 0:
            return joints.copy()
        count = 2.0 * np.pi / self.noise.encoder_counts
        return np.round(joints / count) * count


def _wander(
    error: Float[np.ndarray, "3"], sigma: float, step: float, rng: np.random.Generator
) -> Float[np.ndarray, "3"]:
    keep = np.exp(-step)
    return keep * error + sigma * np.sqrt(1.0 - keep**2) * rng.standard_normal(3)
