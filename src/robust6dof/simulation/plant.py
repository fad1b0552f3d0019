"""The vehicle in MuJoCo under its flight controller: velocities in, motion out."""

# MuJoCo's names come out of a compiled module, which pyright cannot look into.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

from dataclasses import dataclass, field

import mujoco
import numpy as np
from jaxtyping import Float

from robust6dof.geometry.transforms import make_transform, skew
from robust6dof.robot.aerial_manipulator import AerialManipulator
from robust6dof.simulation.air import Wind, WindConfig, drag_force, ground_effect
from robust6dof.simulation.autopilot import (
    GRAVITY,
    Autopilot,
    AutopilotConfig,
    AutopilotState,
    VehicleEstimate,
)
from robust6dof.simulation.estimator import EstimatorNoise, StateEstimator
from robust6dof.simulation.model import build_model, mass_model
from robust6dof.simulation.vehicle import Mixer, QuadrotorParameters
from robust6dof.synthetic.room import Surface

_CROSS = -skew(np.eye(3))
"""Levi-Civita's symbol: a × b = einsum("ijk,j,k->i", _CROSS, a, b)."""


@dataclass(frozen=True)
class PlantConfig:
    """Everything about the vehicle that a scenario may change."""

    quadrotor: QuadrotorParameters = field(default_factory=QuadrotorParameters)
    autopilot: AutopilotConfig = field(default_factory=AutopilotConfig)
    noise: EstimatorNoise = field(default_factory=EstimatorNoise)
    wind: WindConfig = field(default_factory=WindConfig)
    timestep: float = 0.005
    """Of the physics and of the flight controller [s]; a whole part of the servo's period."""


@dataclass(frozen=True, eq=False)
class VehicleCommand:
    """All that guidance may ask of the vehicle."""

    velocity_body: Float[np.ndarray, "3"]
    """Of the body's origin, body axes [m/s]."""
    yaw_rate: float
    """[rad/s]"""
    joint_rates: Float[np.ndarray, "4"]
    """[rad/s]"""

    @staticmethod
    def hold() -> VehicleCommand:
        """Stand still."""
        return VehicleCommand(np.zeros(3), 0.0, np.zeros(4))


@dataclass(frozen=True, eq=False)
class VehicleState:
    """The true state at one instant."""

    time: float
    """[s]"""
    T_world_body: Float[np.ndarray, "4 4"]
    velocity_body: Float[np.ndarray, "3"]
    """Of the body's origin, body axes [m/s]."""
    rates_body: Float[np.ndarray, "3"]
    """[rad/s]"""
    joints: Float[np.ndarray, "4"]
    """[rad]"""
    joint_rates: Float[np.ndarray, "4"]
    """[rad/s]"""
    T_world_cam: Float[np.ndarray, "4 4"]

    @property
    def roll_pitch_yaw(self) -> Float[np.ndarray, "3"]:
        """Angles about x, y', z'' of the body (yaw first) [rad]."""
        R = self.T_world_body[:3, :3]
        pitch = -np.arcsin(np.clip(R[2, 0], -1.0, 1.0))
        return np.array([np.arctan2(R[2, 1], R[2, 2]), pitch, np.arctan2(R[1, 0], R[0, 0])])


@dataclass(frozen=True, eq=False)
class OnboardReading:
    """What the vehicle measures of itself and hands to guidance.

    Rates and velocities are means since the last reading: times the period they are what the
    vehicle really moved.
    """

    joints: Float[np.ndarray, "4"]
    """Encoder angles now [rad]."""
    tilt_rates: Float[np.ndarray, "2"]
    """The gyroscope's (ω_x, ω_y) [rad/s]."""
    velocity_body: Float[np.ndarray, "3"]
    """Estimated, body axes [m/s]."""
    yaw_rate: float
    """The gyroscope's ω_z [rad/s]."""
    joint_rates: Float[np.ndarray, "4"]
    """From the encoders [rad/s]."""
    height: float
    """Above the floor, as estimated [m]."""


class AerialPlant:
    """One flight. MuJoCo's data, the loops' states and the generator inside change as it runs.

    Args:
        manipulator: vehicle frame, arm and camera; the model is generated from it.
        config: vehicle, controller, noise and wind.
        surfaces: tops of the floor and of furniture, for contact and ground effect.
        T_world_body: start, level.
        joints: start [rad].
        rng: of wind and sensors.
    """

    def __init__(
        self,
        manipulator: AerialManipulator,
        config: PlantConfig,
        surfaces: tuple[Surface, ...],
        T_world_body: Float[np.ndarray, "4 4"],
        joints: Float[np.ndarray, "4"],
        rng: np.random.Generator,
    ) -> None:
        self.manipulator, self.config, self.surfaces = manipulator, config, surfaces
        self.model = build_model(manipulator, config.quadrotor, surfaces, config.timestep)
        self.data = mujoco.MjData(self.model)
        self._rng = rng
        self._mixer = Mixer(config.quadrotor)
        self._autopilot = Autopilot(mass_model(self.model, joints), config.autopilot)
        self._estimator = StateEstimator(config.noise)
        self._errors = self._estimator.start(rng)
        self._wind = Wind(config.wind)
        self._turbulence = self._wind.start(rng)
        self._motions: list[Float[np.ndarray, "M"]] = []
        self._base = mujoco.mj_name2id(self.model, mujoco.mjtObj.mjOBJ_BODY, "base")
        self._place(T_world_body, joints)

    def _place(self, T_world_body: Float[np.ndarray, "4 4"], joints: np.ndarray) -> None:
        self.data.qpos[:3] = T_world_body[:3, 3]
        mujoco.mju_mat2Quat(self.data.qpos[3:7], T_world_body[:3, :3].flatten())
        self.data.qpos[7:] = joints
        self.data.act[4:] = joints
        self.data.act[:4] = self._autopilot.mass_model.mass * GRAVITY / 4.0
        mujoco.mj_forward(self.model, self.data)
        self._loops = AutopilotState(yaw=float(np.arctan2(T_world_body[1, 0], T_world_body[0, 0])))

    @property
    def time(self) -> float:
        """[s]"""
        return float(self.data.time)

    @property
    def touched(self) -> bool:
        """Whether the vehicle or its arm is in contact with anything now."""
        return self.data.ncon > 0

    def state(self) -> VehicleState:
        """The truth now."""
        R_world_body = np.empty(9)
        mujoco.mju_quat2Mat(R_world_body, self.data.qpos[3:7])
        T_world_body = make_transform(R_world_body.reshape(3, 3), self.data.qpos[:3])
        joints = self.data.qpos[7:].copy()
        return VehicleState(
            time=self.time,
            T_world_body=T_world_body,
            velocity_body=T_world_body[:3, :3].T @ self.data.qvel[:3],
            rates_body=self.data.qvel[3:6].copy(),
            joints=joints,
            joint_rates=self.data.qvel[6:].copy(),
            T_world_cam=T_world_body @ self.manipulator.T_body_cam(joints),
        )

    def read(self) -> OnboardReading:
        """What guidance is told; averages what moved since the last call."""
        # MuJoCo moves by the velocity at the end of a step: the first is the last period's.
        motions = [*self._motions[1:], self._motion(self._estimate())]
        motion = np.mean(motions, axis=0)
        self._motions = []
        return OnboardReading(
            joints=self._estimator.read_encoders(self.data.qpos[7:]),
            tilt_rates=motion[3:5],
            velocity_body=motion[:3],
            yaw_rate=float(motion[5]),
            joint_rates=motion[6:],
            height=self._estimator.read_height(float(self.data.qpos[2]), self._rng),
        )

    def _motion(self, estimate: VehicleEstimate) -> Float[np.ndarray, "M"]:
        """(v, ω, η̇) as estimated now, body axes."""
        velocity = estimate.R_world_body.T @ estimate.velocity_world
        return np.concatenate([velocity, estimate.rates_body, self.data.qvel[6:]])

    def advance(self, command: VehicleCommand, duration: float) -> None:
        """Fly `command` for `duration` [s]."""
        for _ in range(round(duration / self.config.timestep)):
            self._step(command)

    def _step(self, command: VehicleCommand) -> None:
        dt = self.config.timestep
        self._errors = self._estimator.step(self._errors, dt, self._rng)
        self._turbulence = self._wind.step(self._turbulence, dt, self._rng)
        self._loops, thrust, torque, estimate = self._control(command)
        self._motions.append(self._motion(estimate))
        self.data.ctrl[:4] = self._mixer.rotor_thrusts(thrust, torque)
        self.data.ctrl[4:] = command.joint_rates
        self._blow()
        mujoco.mj_step(self.model, self.data)

    def _control(
        self, command: VehicleCommand
    ) -> tuple[AutopilotState, float, Float[np.ndarray, "3"], VehicleEstimate]:
        estimate = self._estimate()
        R_world_body = self.data.xmat[self._base].reshape(3, 3)
        center_of_mass = R_world_body.T @ (
            self.data.subtree_com[self._base] - self.data.xpos[self._base]
        )
        state, thrust, torque = self._autopilot.step(
            self._loops,
            estimate,
            command.velocity_body,
            command.yaw_rate,
            center_of_mass,
            self.config.timestep,
        )
        return state, thrust, torque, estimate

    def _estimate(self) -> VehicleEstimate:
        R_world_body = self.data.xmat[self._base].reshape(3, 3)
        velocity, rates = self.data.qvel[:3].copy(), self.data.qvel[3:6].copy()
        return self._estimator.observe(self._errors, R_world_body, velocity, rates, self._rng)

    def _blow(self) -> None:
        """Put drag and ground effect on the vehicle's body."""
        quadrotor = self.config.quadrotor
        R_world_body = self.data.xmat[self._base].reshape(3, 3)
        airspeed = self.data.qvel[:3] - self._wind.velocity(self._turbulence, self.time)
        force = drag_force(quadrotor, airspeed, R_world_body)
        arms = quadrotor.rotor_positions @ R_world_body.T
        heights = self._heights(self.data.xpos[self._base] + arms)
        extra = (ground_effect(quadrotor, heights) - 1.0) * self.data.act[:4]
        lifts = extra[:, None] * R_world_body[:, 2]
        self.data.xfrc_applied[self._base, :3] = force + lifts.sum(axis=0)
        self.data.xfrc_applied[self._base, 3:] = np.einsum("ijk,rj,rk->i", _CROSS, arms, lifts)

    def _heights(self, points: Float[np.ndarray, "R 3"]) -> Float[np.ndarray, "R"]:
        """Height of each point above the highest surface under it [m]."""
        below = np.full(len(points), np.inf)
        for surface in self.surfaces:
            gap = points[:, 2] - surface.top
            inside = surface.covers(points) & (gap > 0)
            below = np.where(inside, np.minimum(below, gap), below)
        return below
