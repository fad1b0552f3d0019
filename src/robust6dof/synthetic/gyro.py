"""What a gyro in the synthetic camera would have measured."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from robust6dof.synthetic.camera_motion import twist_along
from robust6dof.synthetic.sequence import SyntheticSequence

_STREAM = 0x6779726F
"""Random numbers of its own, so that the images stay the same."""


@dataclass(frozen=True)
class GyroConfig:
    """A consumer's MEMS gyro: the order of a Bosch BMI055, which the D435i carries."""

    rate_hz: float = 200.0
    noise_density: float = np.deg2rad(0.014)
    """[rad/s/√Hz]"""
    bias: float = np.deg2rad(1.0)
    """Standard deviation of the zero-rate offset of each axis [rad/s]; nobody calibrated it."""
    scale: float = 0.01
    """Standard deviation of the sensitivity's error of each axis."""


def measure_turning(
    sequence: SyntheticSequence, config: GyroConfig | None = None
) -> tuple[Float[np.ndarray, "S"], Float[np.ndarray, "S 3"]]:
    """Times [s] and angular velocities [rad/s], camera axes, over the whole recording."""
    config = config or GyroConfig()
    rng = np.random.default_rng([sequence.seed, _STREAM])
    count = int(np.ceil(sequence.stamps[-1] * config.rate_hz)) + 1
    stamps = np.arange(count) / config.rate_hz
    true = np.stack([twist_along(sequence.T_world_cam, float(t))[3:] for t in stamps])
    scale = 1.0 + rng.normal(0.0, config.scale, 3)
    noise = rng.normal(0.0, config.noise_density * np.sqrt(config.rate_hz / 2), true.shape)
    return stamps, scale * true + rng.normal(0.0, config.bias, 3) + noise
