"""Gusts, drag, ground effect."""

import numpy as np
from scipy.spatial.transform import Rotation

from robust6dof.simulation.air import Wind, WindConfig, drag_force, ground_effect
from robust6dof.simulation.vehicle import QuadrotorParameters

QUADROTOR = QuadrotorParameters()


def test_turbulence_has_the_stated_spread_and_memory():
    wind = Wind(WindConfig(turbulence=(0.5, 0.5, 0.2), correlation_time=0.5))
    rng = np.random.default_rng(0)
    turbulence, samples = wind.start(rng), []
    for _ in range(8_000):
        turbulence = wind.step(turbulence, 0.1, rng)
        samples.append(turbulence)
    table = np.array(samples)
    np.testing.assert_allclose(table.std(axis=0), [0.5, 0.5, 0.2], rtol=0.08)
    later = np.corrcoef(table[:-5, 0], table[5:, 0])[0, 1]
    assert abs(later - np.exp(-1.0)) < 0.08


def test_a_discrete_gust_rises_and_falls():
    wind = Wind(WindConfig(gust=(2.0, 0.0, 0.0), gust_start=1.0, gust_duration=4.0))
    speeds = [wind.velocity(np.zeros(3), time)[0] for time in (0.5, 2.0, 3.0, 4.0, 6.0)]
    np.testing.assert_allclose(speeds, [0.0, 1.0, 2.0, 1.0, 0.0], atol=1e-12)


def test_drag_opposes_the_airspeed_at_any_attitude():
    rng = np.random.default_rng(1)
    for _ in range(20):
        airspeed = rng.normal(size=3)
        R = Rotation.random(rng=rng).as_matrix()
        assert drag_force(QUADROTOR, airspeed, R) @ airspeed < 0
    assert not drag_force(QUADROTOR, np.zeros(3), np.eye(3)).any()


def test_ground_effect_fades_with_height_and_stays_bounded():
    factors = ground_effect(QUADROTOR, np.array([0.0, 0.05, 0.1, 0.3, 1.0, np.inf]))
    assert (np.diff(factors) <= 0).all()
    assert factors[0] < 1.4
    assert factors[-2] < 1.002
    assert factors[-1] == 1.0
