"""Smooth random signals of bounded size and rate: what the motions are made of."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from jaxtyping import Float

_WAVES = 4


@dataclass(frozen=True, eq=False)
class SmoothNoise:
    """A sum of sinusoids with random phases: smooth, endless, with known bounds."""

    amplitudes: Float[np.ndarray, " W"]
    frequencies_hz: Float[np.ndarray, " W"]
    phases: Float[np.ndarray, " W"]

    @staticmethod
    def draw(rng: np.random.Generator, peak: float, peak_rate: float) -> SmoothNoise:
        """A signal that stays within ±`peak` and changes by at most `peak_rate` a second.

        Both bounds hold for all time (they bound the sums of the waves' own peaks).
        """
        shares = rng.dirichlet(np.full(_WAVES, 2.0))
        if peak <= 0 or peak_rate <= 0:
            return SmoothNoise(np.zeros(1), np.ones(1), np.zeros(1))
        relative = rng.uniform(0.35, 1.0, _WAVES)
        # Σ aᵢ 2π fᵢ = peak_rate with aᵢ = peak·shareᵢ fixes the common factor of the frequencies.
        frequencies = relative * peak_rate / (2 * np.pi * peak * float(shares @ relative))
        return SmoothNoise(peak * shares, frequencies, rng.uniform(0, 2 * np.pi, _WAVES))

    def __call__(self, t: float) -> float:
        """Value at time `t` [s]."""
        waves = np.sin(2 * np.pi * self.frequencies_hz * t + self.phases)
        return float(self.amplitudes @ waves)


@dataclass(frozen=True)
class Event:
    """A smooth window: 0, up to 1 over `rise`, stays for `hold`, and back down."""

    STEEPEST: ClassVar[float] = 1.875
    """Greatest slope of the rise, times its duration."""

    start: float
    """Begin of the rise [s]."""
    rise: float
    """Duration of the rise and of the fall [s]."""
    hold: float
    """Time at 1 [s]."""

    @property
    def end(self) -> float:
        """Time at which it is over [s]."""
        return self.start + 2 * self.rise + self.hold

    def __call__(self, t: float) -> float:
        """Weight in [0, 1] at time `t` [s]; twice differentiable (smootherstep)."""
        up = (t - self.start) / self.rise
        down = (self.end - t) / self.rise
        x = float(np.clip(min(up, down), 0.0, 1.0))
        return x * x * x * (x * (6 * x - 15) + 10)


def draw_events(
    rng: np.random.Generator,
    duration: float,
    period: float,
    *,
    rise: tuple[float, float],
    hold: tuple[float, float],
    quiet: float = 0.7,
) -> tuple[Event, ...]:
    """Events one after another, about one each `period` [s]; none in the first `quiet` seconds."""
    events: list[Event] = []
    t = quiet + rng.exponential(period)
    while t < duration:
        events.append(Event(t, rng.uniform(*rise), rng.uniform(*hold)))
        t = events[-1].end + 0.3 + rng.exponential(period)
    return tuple(events)
