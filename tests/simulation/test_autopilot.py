"""The flight controller: its limits over random states, and the lag that guidance counts on."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from robust6dof.simulation.autopilot import (
    Autopilot,
    AutopilotConfig,
    AutopilotState,
    MassModel,
    VehicleEstimate,
)
from robust6dof.simulation.plant import VehicleCommand
from simulation.flights import airborne

AUTOPILOT = Autopilot(MassModel(2.4, np.array([0.03, 0.03, 0.04])))
CONFIG = AutopilotConfig()
vectors = st.lists(st.floats(-8, 8), min_size=3, max_size=3).map(np.array)
tilts = st.lists(st.floats(-0.6, 0.6), min_size=3, max_size=3).map(np.array)


@given(vectors, vectors, vectors, tilts, st.floats(-3, 3))
def test_no_more_tilt_is_ever_asked_for_than_the_limit(wanted, velocity, integral, tilt, yaw_rate):
    """Level vehicle, no rates: the torque is the rate loop's answer to the tilt asked for."""
    asked = AUTOPILOT._limit_tilt(integral + wanted)
    assert np.arccos(asked[2] / np.linalg.norm(asked)) <= CONFIG.max_tilt + 1e-9
    R = Rotation.from_rotvec(tilt).as_matrix()
    estimate = VehicleEstimate(R, velocity, np.zeros(3))
    state = AutopilotState(yaw=estimate.yaw, acceleration=integral)
    state, thrust, torque = AUTOPILOT.step(state, estimate, wanted, yaw_rate, np.zeros(3), 0.005)
    assert thrust >= 0
    most = (np.array(CONFIG.rate_gain) + np.array(CONFIG.rate_integral_gain) * 0.005) * np.array(
        CONFIG.max_rate
    )
    assert np.all(np.abs(torque) <= AUTOPILOT.mass_model.inertia * most + 1e-9)
    assert np.abs(state.acceleration).max() <= CONFIG.max_acceleration + 1e-9


def test_a_velocity_step_is_followed_with_the_stated_lag():
    """The area between demand and velocity, over the step's height, is the lag of a first-order
    response; so much does the vehicle stay behind, and so much does guidance lead by."""
    plant = airborne()
    for _ in range(60):
        plant.advance(VehicleCommand(np.array([0.3, 0.0, 0.0]), 0.0, np.zeros(4)), 0.05)
    behind = 0.3 * 3.0 - plant.state().T_world_body[0, 3]
    assert abs(behind / 0.3 - CONFIG.velocity_lag) < 0.06
