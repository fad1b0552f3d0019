"""The rotor mixer."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from robust6dof.simulation.vehicle import Mixer, QuadrotorParameters

MIXER = Mixer(QuadrotorParameters())


def test_a_feasible_wrench_is_met_exactly():
    torque = np.array([0.3, -0.2, 0.05])
    thrusts = MIXER.rotor_thrusts(24.0, torque)
    np.testing.assert_allclose(MIXER.allocation @ thrusts, [24.0, *torque], atol=1e-12)


def test_allocation_is_the_sum_of_the_rotors_wrenches():
    quadrotor = MIXER.quadrotor
    thrusts = np.array([5.0, 6.0, 7.0, 4.0])
    forces = thrusts[:, None] * np.array([0.0, 0.0, 1.0])
    torque = np.cross(quadrotor.rotor_positions, forces).sum(axis=0)
    torque[2] += (quadrotor.rotor_spins * quadrotor.yaw_moment * thrusts).sum()
    np.testing.assert_allclose(MIXER.allocation @ thrusts, [thrusts.sum(), *torque], atol=1e-12)


torques = st.floats(-20.0, 20.0)


@given(st.floats(-10.0, 100.0), torques, torques, torques)
def test_no_rotor_ever_exceeds_its_limits(thrust, x, y, z):
    thrusts = MIXER.rotor_thrusts(thrust, np.array([x, y, z]))
    assert (thrusts >= 0.0).all()
    assert (thrusts <= MIXER.quadrotor.max_thrust).all()


@given(st.floats(0.0, 48.0), st.floats(-1.5, 1.5), st.floats(-1.5, 1.5), torques)
def test_roll_and_pitch_come_before_yaw_and_thrust(thrust, x, y, z):
    thrusts = MIXER.rotor_thrusts(thrust, np.array([x, y, z]))
    np.testing.assert_allclose((MIXER.allocation @ thrusts)[1:3], [x, y], atol=1e-9)
