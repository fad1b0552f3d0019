"""Paths of moving things."""

import numpy as np
import pytest

from robust6dof.synthetic.paths import (
    Circle,
    Excursion,
    Still,
    StopAndGo,
    Straight,
    moved_along,
)

PATHS = [
    Still(),
    Straight(0.4, 0.7),
    Circle(0.3, 0.8, -1.0),
    StopAndGo(0.5, 2.0),
    Excursion(1.5, 0.3, start=3.0, travel=2.0, pause=2.0),
]


@pytest.mark.parametrize("path", PATHS)
def test_begins_at_rest_and_never_jumps(path):
    times = np.arange(0.0, 20.0, 0.01)
    places = np.array([path.displacement(time) for time in times])
    assert not places[0].any()
    assert np.abs(np.diff(places, axis=0)).max() < 0.02
    assert np.abs(np.diff(places, n=2, axis=0)).max() < 3e-4  # below 3 m/s²


def test_speeds_are_as_stated():
    for path, speed in ((Straight(0.4, 0.7), 0.4), (Circle(0.3, 0.8, -1.0), 0.3)):
        before, after = (np.array(path.displacement(time)[:2]) for time in (8.0, 8.01))
        assert abs(np.linalg.norm(after - before) / 0.01 - speed) < 1e-3


def test_stop_and_go_covers_its_distance_and_stands():
    path = StopAndGo(0.5, 0.0, period=4.0, start=2.0)
    assert abs(path.displacement(6.0)[0] - 2.0) < 1e-9
    assert abs(path.displacement(9.9)[0] - 2.0) < 1e-9
    assert abs(path.displacement(14.0)[0] - 4.0) < 1e-9


def test_an_excursion_comes_back():
    path = Excursion(1.5, 0.3, start=3.0, travel=2.0, pause=2.0)
    assert abs(np.hypot(*path.displacement(6.0)[:2]) - 1.5) < 1e-9
    assert abs(np.hypot(*path.displacement(9.5)[:2])) < 1e-9


def test_a_thing_turns_with_its_path_about_itself():
    T = np.eye(4)
    T[:3, 3] = [0.2, 0.1, 0.5]
    path = Circle(0.3, 0.8, heading=0.0)
    x, y, turn = path.displacement(5.0)
    moved = moved_along(path, T, 5.0)
    np.testing.assert_allclose(moved[:3, 3], [0.2 + x, 0.1 + y, 0.5])
    np.testing.assert_allclose(moved[:2, 0], [np.cos(turn), np.sin(turn)])
