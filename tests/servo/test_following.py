"""Commands for a vehicle that follows them with a first-order lag."""

from __future__ import annotations

import numpy as np
import pytest

from robust6dof.servo.config import PadServoConfig
from robust6dof.servo.following import Following

LAG, DT = 0.25, 0.01


def _fly(config: PadServoConfig, known: bool, mistaken_lag: float = LAG) -> float:
    """Greatest distance from a wanted path, of a vehicle with a first-order velocity loop.

    Args:
        known: whether the acceleration is told.
        mistaken_lag: the vehicle's real one.
    """
    following, velocity = Following.none(), np.zeros(3)
    place, path, off = np.zeros(3), np.zeros(3), []
    for i in range(1000):
        t = i * DT
        wanted = np.array([0.3 * np.sin(0.8 * t), 0.2 * np.sin(0.5 * t), 0.0])
        change = np.array([0.24 * np.cos(0.8 * t), 0.1 * np.cos(0.5 * t), 0.0])
        following = following.moved(velocity, 0.0, DT, 1.0)
        command = following.command(wanted, wanted, change * known, 0.0, config)
        following = Following(wanted, following.shortfall)
        velocity = velocity + (command - velocity) * DT / mistaken_lag
        place, path = place + velocity * DT, path + wanted * DT
        off.append(np.linalg.norm(place - path))
    return max(off[300:])


def test_a_known_lag_is_met_by_the_acceleration_and_an_unknown_rest_by_odometry():
    nothing = PadServoConfig(vehicle_lag=0.0, shortfall_gain=0.0)
    lead = PadServoConfig(vehicle_lag=LAG, shortfall_gain=0.0)
    both = PadServoConfig(vehicle_lag=LAG, shortfall_gain=2.0)
    assert _fly(nothing, known=True) > 0.06
    assert _fly(lead, known=True) < 0.03  # the transient of its start, which nothing takes back
    assert _fly(both, known=True) < 0.005
    assert _fly(both, known=True, mistaken_lag=0.4) < 0.04
    assert _fly(lead, known=True, mistaken_lag=0.4) > 0.04


def test_a_velocity_that_turns_with_the_vehicle_is_asked_for_ahead():
    config = PadServoConfig(vehicle_lag=0.2)
    velocity = Following.none().command(
        np.array([0.4, 0.0, 0.1]), np.zeros(3), np.zeros(3), 0.5, config
    )
    np.testing.assert_allclose(velocity, [0.4, 0.2 * 0.5 * 0.4, 0.1])


def test_shortfall_stays_where_it_is_over_ground_while_the_vehicle_turns():
    following = Following(np.zeros(3), np.array([0.1, 0.0, 0.05]))
    for _ in range(1000):
        following = following.moved(np.zeros(3), np.pi / 2, 1e-3, 1.0)
    np.testing.assert_allclose(following.shortfall, [0.0, -0.1, 0.05], atol=2e-4)


def test_no_more_than_its_limit_is_remembered():
    following = Following(np.ones(3), np.zeros(3))
    for _ in range(100):
        following = following.moved(np.zeros(3), 0.3, 0.05, 0.15)
    assert np.linalg.norm(following.shortfall) == pytest.approx(0.15)
