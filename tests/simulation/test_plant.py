"""The flown vehicle: hover, step responses, the arm, and agreement with the kinematics."""

import mujoco
import numpy as np

from robust6dof.simulation.air import WindConfig
from robust6dof.simulation.plant import PlantConfig, VehicleCommand
from simulation.flights import CALM, airborne

HOLD = VehicleCommand.hold()
MID_AIR = np.array([0.5, -0.2, -0.4, 0.6])


def forward(*velocity, yaw_rate=0.0):
    return VehicleCommand(np.array(velocity, dtype=float), yaw_rate, np.zeros(4))


def test_hovers_in_a_draught_with_noisy_sensors():
    plant = airborne(PlantConfig())
    plant.advance(HOLD, 3.0)
    state = plant.state()
    assert np.linalg.norm(state.velocity_body) < 0.06
    assert np.linalg.norm(state.T_world_body[:3, 3] - [0, 0, 1.5]) < 0.12
    assert np.abs(np.degrees(state.roll_pitch_yaw)).max() < 1.5


def test_the_arms_weight_is_fed_forward_at_once():
    plant = airborne(joints=np.array([1.2, 0.3, 0.3, 1.0]))
    plant.advance(HOLD, 0.5)
    assert np.abs(np.degrees(plant.state().roll_pitch_yaw)).max() < 0.5
    assert np.linalg.norm(plant.state().velocity_body) < 0.02


def test_velocity_step_settles_on_the_command():
    plant, wanted = airborne(), np.array([0.4, -0.3, 0.2])
    plant.advance(forward(*wanted), 0.8)
    early = plant.state().velocity_body / wanted
    plant.advance(forward(*wanted), 2.2)
    assert (early > 0.6).all()
    assert (early < 1.15).all()
    np.testing.assert_allclose(plant.state().velocity_body, wanted, atol=0.03)


def test_the_command_is_in_body_axes():
    plant = airborne()
    plant.advance(forward(0, 0, 0, yaw_rate=1.0), 1.0)
    plant.advance(forward(0.3, 0, 0), 2.0)
    state = plant.state()
    heading = state.T_world_body[:2, 0]
    world_velocity = state.T_world_body[:3, :3] @ state.velocity_body
    assert abs(state.roll_pitch_yaw[2] - 1.0) < 0.1
    np.testing.assert_allclose(world_velocity[:2], 0.3 * heading, atol=0.03)


def test_yaw_rate_is_tracked():
    plant = airborne()
    plant.advance(forward(0, 0, 0, yaw_rate=0.5), 1.5)
    assert abs(plant.state().rates_body[2] - 0.5) < 0.03


def test_accelerating_tilts_the_vehicle_within_its_limit():
    plant, tilts = airborne(), []
    for _ in range(12):
        plant.advance(forward(3.0, 0, 0), 0.05)
        tilts.append(np.degrees(np.arccos(plant.state().T_world_body[2, 2])))
    assert 10 < max(tilts) < 25


def test_joints_follow_their_rates_and_stop_at_their_limits():
    plant = airborne()
    rates = np.array([0.4, -0.2, -0.3, 0.5])
    plant.advance(VehicleCommand(np.zeros(3), 0.0, rates), 1.0)
    np.testing.assert_allclose(plant.state().joint_rates, rates, atol=0.02)
    np.testing.assert_allclose(plant.state().joints, rates * 0.96, atol=0.03)
    plant.advance(VehicleCommand(np.zeros(3), 0.0, 2.0 * np.ones(4)), 1.2)
    upper = plant.manipulator.arm.upper
    np.testing.assert_allclose(plant.state().joints, upper, atol=0.03)
    # The set-point does not run away behind a limit: the way back begins at once.
    plant.advance(VehicleCommand(np.zeros(3), 0.0, -np.ones(4)), 0.3)
    assert (plant.state().joints < upper - 0.15).all()


def test_moving_the_whole_arm_hardly_moves_the_vehicle():
    plant, drift = airborne(), []
    for tick in range(40):
        rates = 0.5 * np.sin(0.2 * tick + np.arange(4))
        plant.advance(VehicleCommand(np.zeros(3), 0.0, rates), 0.05)
        drift.append(np.linalg.norm(plant.state().velocity_body))
    assert max(drift) < 0.08


def test_camera_agrees_with_mujocos_own_kinematics():
    plant = airborne(joints=MID_AIR)
    plant.advance(VehicleCommand(np.array([0.2, 0.1, 0]), 0.4, np.full(4, 0.2)), 0.8)
    mujoco.mj_forward(plant.model, plant.data)
    site, T_world_cam = plant.data.site("camera"), plant.state().T_world_cam
    np.testing.assert_allclose(site.xpos, T_world_cam[:3, 3], atol=1e-12)
    np.testing.assert_allclose(site.xmat.reshape(3, 3), T_world_cam[:3, :3], atol=1e-12)


def test_camera_jacobian_agrees_with_mujocos():
    plant = airborne(joints=MID_AIR)
    plant.advance(VehicleCommand(np.array([0.2, 0.1, 0]), 0.4, np.full(4, 0.2)), 0.8)
    mujoco.mj_forward(plant.model, plant.data)
    state, linear, angular = plant.state(), np.zeros((3, 10)), np.zeros((3, 10))
    mujoco.mj_jacSite(plant.model, plant.data, linear, angular, plant.data.site("camera").id)
    R_cam_world = state.T_world_cam[:3, :3].T
    expected = np.vstack([R_cam_world @ linear, R_cam_world @ angular])
    expected[:, :3] = expected[:, :3] @ state.T_world_body[:3, :3]  # MuJoCo's are world velocities
    actual = plant.manipulator.camera_jacobian(state.joints)
    np.testing.assert_allclose(actual, expected, atol=1e-12)


def test_masses_are_those_of_the_data():
    plant = airborne()
    arm, quadrotor = plant.manipulator.arm, CALM.quadrotor
    np.testing.assert_allclose(plant.model.body_mass.sum(), quadrotor.mass + arm.mass)


def test_same_seed_same_flight_other_seed_other_flight():
    ends = []
    for seed in (3, 3, 4):
        plant = airborne(PlantConfig(), seed=seed)
        plant.advance(forward(0.2, 0, 0), 0.3)
        ends.append(plant.state().T_world_body)
    assert (ends[0] == ends[1]).all()
    assert (ends[0] != ends[2]).any()


def test_a_steady_wind_is_held_against():
    windy = WindConfig(mean=(3.0, 0.0, 0.0), turbulence=(0.0, 0.0, 0.0))
    plant = airborne(PlantConfig(noise=CALM.noise, wind=windy))
    plant.advance(HOLD, 5.0)
    state = plant.state()
    assert np.linalg.norm(state.velocity_body) < 0.05
    assert np.degrees(state.roll_pitch_yaw[1]) < -1.0  # it leans into the wind


def test_touching_the_floor_is_noticed():
    plant = airborne(height=0.6)
    assert not plant.touched
    plant.advance(forward(0, 0, -0.8), 1.2)
    assert plant.touched


def test_the_gyroscope_is_averaged_over_the_tick():
    plant = airborne()
    plant.read()
    plant.advance(forward(0.5, 0, 0), 0.05)
    first = plant.read()
    assert first.tilt_rates.shape == (2,)
    assert abs(first.tilt_rates[1]) > 5 * abs(first.tilt_rates[0])
