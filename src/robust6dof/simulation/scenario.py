"""What is asked of guidance: the named scenarios and what each lets vary."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from robust6dof.errors import InputError
from robust6dof.simulation.air import WindConfig


@dataclass(frozen=True)
class StartRange:
    """Where guidance may begin, relative to the goal camera above the object."""

    distance: tuple[float, float] = (0.5, 1.5)
    """Of the camera from the goal camera [m]."""
    view_angle: tuple[float, float] = (np.deg2rad(20.0), np.deg2rad(60.0))
    """Between the optical axes of start and goal [rad]."""
    image_margin: float = 0.22
    """The object's centre is at least this share of the image away from each edge."""
    min_visible: float = 0.75
    """Share of the object's silhouette that clutter must leave in view."""


@dataclass(frozen=True)
class Scenario:
    """One kind of task."""

    name: str
    on_table: bool = True
    """On a table, or on a low cart on the floor."""
    motion: str = "still"
    """still, straight, circle, stop-and-go, mixed (one of the three, drawn) or excursion."""
    speed: tuple[float, float] = (0.0, 0.0)
    """Of the target [m/s]."""
    occlusion: bool = False
    """A board passes between camera and object."""
    half_width: float = 3.6
    """From the middle of the room to its walls [m]."""
    wind: WindConfig = field(default_factory=WindConfig)
    clutter: tuple[int, int] = (3, 6)
    """Fewest and most objects beside the target."""
    start: StartRange = field(default_factory=StartRange)
    stops_when_reached: bool = True
    """Otherwise the run lasts to its time limit (a moving target is followed)."""


SCENARIOS = {
    scenario.name: scenario
    for scenario in (
        Scenario("table"),
        Scenario(
            "moving",
            on_table=False,
            motion="mixed",
            speed=(0.1, 0.5),
            half_width=36.0,
            clutter=(0, 0),
            stops_when_reached=False,
        ),
        Scenario("occlusion", occlusion=True),
        Scenario(
            "leave-and-return",
            on_table=False,
            motion="excursion",
            clutter=(0, 0),
            stops_when_reached=False,
        ),
        Scenario(
            "gust",
            wind=WindConfig(
                mean=(1.0, 0.5, 0.0), turbulence=(0.6, 0.6, 0.25), gust=(3.0, 1.5, 0.0)
            ),
        ),
    )
}
"""By name."""


def scenario_named(name: str) -> Scenario:
    """Look a scenario up.

    Raises:
        InputError: there is none of that name.
    """
    if name not in SCENARIOS:
        raise InputError(f"no scenario '{name}'; there is: {', '.join(SCENARIOS)}")
    return SCENARIOS[name]
