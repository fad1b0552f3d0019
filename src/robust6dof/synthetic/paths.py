"""Paths of things that move: the target on a ground vehicle, a board that hides it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from robust6dof.geometry.transforms import make_transform


@runtime_checkable
class Path(Protocol):
    """A planar motion: where something has gone from its place at time 0."""

    def displacement(self, time: float) -> tuple[float, float, float]:
        """x, y [m] and turn about the vertical [rad] since time 0."""
        ...


@dataclass(frozen=True)
class Still:
    """No motion."""

    def displacement(self, time: float) -> tuple[float, float, float]:
        return 0.0, 0.0, 0.0


@dataclass(frozen=True)
class Straight:
    """Constant velocity after a gentle start."""

    speed: float
    """[m/s]"""
    heading: float
    """[rad]"""
    start: float = 2.0
    """[s]"""
    ramp: float = 1.0
    """Time to reach the speed [s]."""

    def displacement(self, time: float) -> tuple[float, float, float]:
        distance = self.speed * _ramped(time - self.start, self.ramp)
        return distance * np.cos(self.heading), distance * np.sin(self.heading), 0.0


@dataclass(frozen=True)
class Circle:
    """A circle at constant speed; the target turns with its path."""

    speed: float
    """[m/s]"""
    radius: float
    """[m]"""
    heading: float
    """At the start [rad]."""
    start: float = 2.0
    """[s]"""
    ramp: float = 1.0
    """[s]"""

    def displacement(self, time: float) -> tuple[float, float, float]:
        turn = self.speed * _ramped(time - self.start, self.ramp) / self.radius
        along, left = self.radius * np.sin(turn), self.radius * (1.0 - np.cos(turn))
        c, s = np.cos(self.heading), np.sin(self.heading)
        return c * along - s * left, s * along + c * left, turn


@dataclass(frozen=True)
class StopAndGo:
    """Straight on, standing every other period."""

    speed: float
    """[m/s]"""
    heading: float
    """[rad]"""
    period: float = 4.0
    """Of one drive and of one stand [s]."""
    start: float = 2.0
    """[s]"""

    def displacement(self, time: float) -> tuple[float, float, float]:
        drives, rest = divmod(max(time - self.start, 0.0), 2.0 * self.period)
        share = min(rest / self.period, 1.0)
        smooth = share - np.sin(2.0 * np.pi * share) / (2.0 * np.pi)
        distance = self.speed * self.period * (drives + smooth)
        return distance * np.cos(self.heading), distance * np.sin(self.heading), 0.0


@dataclass(frozen=True)
class Excursion:
    """Out in a straight line, a pause, and back to the start."""

    distance: float
    """[m]"""
    heading: float
    """[rad]"""
    start: float
    """[s]"""
    travel: float
    """Time of each way [s]."""
    pause: float
    """[s]"""

    def displacement(self, time: float) -> tuple[float, float, float]:
        out = np.clip((time - self.start) / self.travel, 0.0, 1.0)
        back = np.clip((time - self.start - self.travel - self.pause) / self.travel, 0.0, 1.0)
        distance = self.distance * (_eased(float(out)) - _eased(float(back)))
        return distance * np.cos(self.heading), distance * np.sin(self.heading), 0.0


def moved_along(
    path: Path, T_world_thing: Float[np.ndarray, "4 4"], time: float
) -> Float[np.ndarray, "4 4"]:
    """Where a thing that stood at `T_world_thing` is at `time` [s]; it turns about itself."""
    x, y, turn = path.displacement(time)
    R_turn = Rotation.from_euler("z", turn).as_matrix()
    shift = np.array([x, y, 0.0])
    return make_transform(R_turn @ T_world_thing[:3, :3], T_world_thing[:3, 3] + shift)


def way(path: Path, duration: float) -> Float[np.ndarray, "P 2"]:
    """Where the path leads in `duration` seconds: its places each half second [m]."""
    times = np.arange(0.0, duration + 0.5, 0.5)
    return np.array([path.displacement(float(time))[:2] for time in times])


def _ramped(time: float, ramp: float) -> float:
    """Integral of a speed that rises linearly from 0 to 1 over `ramp`."""
    if time <= 0.0:
        return 0.0
    return 0.5 * time**2 / ramp if time < ramp else time - 0.5 * ramp


def _eased(share: float) -> float:
    return share * share * (3.0 - 2.0 * share)
