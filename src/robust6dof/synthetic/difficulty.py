"""How hard the vehicle flies and how much gets in the way."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

DifficultyName = Literal["calm", "agile", "harsh", "leaving"]

BENCHMARK_DIFFICULTIES: tuple[DifficultyName, ...] = ("calm", "agile", "harsh")
"""The three of AerialPose-Sim."""


@dataclass(frozen=True)
class Difficulty:
    """Bounds of the motion and rates of the disturbing events.

    For scale: logs of real multirotors in strong wind show tilt to 31° and rates to 66°/s.
    """

    name: DifficultyName
    swing: float
    """Pitch and roll of the camera about its nominal view, at the height of a burst [rad]."""
    swing_rate: float
    """Bound of the rate of each [rad/s]."""
    orbit_rate: float
    """Bound of the rate at which the view direction circles the object [rad/s]."""
    radial_speed: float
    """Bound of the speed towards and away from the object [m/s]."""
    burst_period: float
    """Mean time between bursts of full swing [s]; outside them the swing is 40 %."""
    target_speed: float
    """Speed of a moving target [m/s]."""
    moving_share: float
    """Share of sequences whose target moves."""
    clutter: tuple[int, int]
    """Least and most objects of other categories on the table."""
    distractors: tuple[int, int]
    """Least and most further objects of the target's own category."""
    occlusion_period: float
    """Mean time between occluders that cross the view [s]."""
    leave_period: float
    """Mean time between spells with the object out of view [s]."""
    drop_share: float
    """Share of frames that never arrive."""


_RAD = np.pi / 180.0

_BENCHMARK: dict[str, Difficulty] = {
    "calm": Difficulty(
        name="calm",
        swing=8 * _RAD,
        swing_rate=25 * _RAD,
        orbit_rate=15 * _RAD,
        radial_speed=0.1,
        burst_period=4.0,
        target_speed=0.1,
        moving_share=0.2,
        clutter=(0, 3),
        distractors=(0, 0),
        occlusion_period=np.inf,
        leave_period=np.inf,
        drop_share=0.0,
    ),
    "agile": Difficulty(
        name="agile",
        swing=20 * _RAD,
        swing_rate=70 * _RAD,
        orbit_rate=35 * _RAD,
        radial_speed=0.25,
        burst_period=2.0,
        target_speed=0.2,
        moving_share=0.4,
        clutter=(2, 5),
        distractors=(0, 1),
        occlusion_period=6.0,
        leave_period=np.inf,
        drop_share=0.02,
    ),
    "harsh": Difficulty(
        name="harsh",
        swing=30 * _RAD,
        swing_rate=120 * _RAD,
        orbit_rate=60 * _RAD,
        radial_speed=0.45,
        burst_period=1.0,
        target_speed=0.35,
        moving_share=0.6,
        clutter=(3, 7),
        distractors=(1, 2),
        occlusion_period=2.0,
        leave_period=4.0,
        drop_share=0.08,
    ),
}

DIFFICULTIES: dict[str, Difficulty] = {
    **_BENCHMARK,
    "leaving": replace(_BENCHMARK["agile"], name="leaving", distractors=(1, 2), leave_period=0.4),
}
"""By name; `leaving` is `agile` with the object out of view again and again, its like beside it: to
count losses and how they end."""
