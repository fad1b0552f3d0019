"""The closed loop: image → tracker → PAD-Servo → flight controller and arm → motion → image."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from robust6dof.geometry.transforms import invert_transform
from robust6dof.rendering.sensor import StereoSensorConfig
from robust6dof.robot.aerial_manipulator import AerialManipulator
from robust6dof.servo.config import PadServoConfig
from robust6dof.servo.pad_servo import PadServo, ServoCommand
from robust6dof.simulation.episode import Episode
from robust6dof.simulation.eye_in_hand import Exposure, EyeInHand
from robust6dof.simulation.judge import Arrival, GoalError, goal_error, tracking_error
from robust6dof.simulation.plant import (
    AerialPlant,
    OnboardReading,
    PlantConfig,
    VehicleCommand,
    VehicleState,
)
from robust6dof.simulation.pose_source import PoseEstimate, PoseSource
from robust6dof.simulation.trace import Row, Trace, pose_signals, vehicle_signals


@dataclass(frozen=True)
class GuidanceConfig:
    """Of the loop itself."""

    servo: PadServoConfig = field(default_factory=PadServoConfig)
    """Law, gains, thresholds and rate; its `vehicle_lag` is set to the plant's."""
    plant: PlantConfig = field(default_factory=PlantConfig)
    """Vehicle and noise; the scenario's wind takes the place of its wind."""
    time_limit: float = 60.0
    """[s]"""
    sensor: StereoSensorConfig | None = None
    """The camera's effects; drawn for each seed about a D435i's if None."""
    hold: float = 1.0
    """How long to go on after the thresholds are reached [s]."""


@dataclass(frozen=True, eq=False)
class GuidanceStep:
    """One tick, as shown to observers (videos, tests)."""

    state: VehicleState
    T_cam_obj: Float[np.ndarray, "4 4"]
    """True now."""
    error: GoalError
    """True now."""
    estimate: PoseEstimate | None
    """What the servo acts on."""
    command: ServoCommand
    exposure: Exposure | None
    """The image taken now, if one was."""


@runtime_checkable
class Observer(Protocol):
    """Looks on; nothing that it does reaches the loop."""

    def wants_image(self, tick: int) -> bool:
        """Whether it needs an image at this tick though the pose source does not."""
        ...

    def see(self, tick: int, step: GuidanceStep) -> None:
        """One tick."""
        ...


@dataclass(frozen=True, eq=False)
class GuidanceRun:
    """A finished run."""

    trace: Trace
    reached_at: float | None
    """When both true errors came below their thresholds to stay (see `Arrival`) [s]."""
    touched: bool
    """Whether the vehicle ran into anything."""


def run_guidance(
    episode: Episode,
    manipulator: AerialManipulator,
    T_cam_obj_goal: Float[np.ndarray, "4 4"],
    poses: PoseSource,
    config: GuidanceConfig | None = None,
    observers: Sequence[Observer] = (),
) -> GuidanceRun:
    """Guide the vehicle from the episode's start until the goal is reached or time is up.

    Only the loop's judge and the observers see the truth; the servo is given the pose source's
    estimates, encoder angles and gyroscope rates.
    """
    loop = _Loop(episode, manipulator, T_cam_obj_goal, poses, config or GuidanceConfig())
    return loop.run(observers)


class _Loop:
    def __init__(
        self,
        episode: Episode,
        manipulator: AerialManipulator,
        T_cam_obj_goal: Float[np.ndarray, "4 4"],
        poses: PoseSource,
        config: GuidanceConfig,
    ) -> None:
        self.episode, self.goal, self.poses, self.config = episode, T_cam_obj_goal, poses, config
        self.symmetric = episode.world.symmetric
        lag = config.plant.autopilot.velocity_lag
        self.servo = PadServo(manipulator, replace(config.servo, vehicle_lag=lag))
        self.plant = _make_plant(episode, manipulator, config.plant)
        self.camera = EyeInHand(episode, manipulator, config.plant.quadrotor, config.sensor)
        self.pending: list[PoseEstimate] = []
        self.latest: PoseEstimate | None = None
        self.truth_at: dict[float, Float[np.ndarray, "4 4"]] = {}

    def run(self, observers: Sequence[Observer]) -> GuidanceRun:
        rows: list[Row] = []
        arrival = Arrival(self.config.servo, self.config.hold)
        touched = False
        period = self.config.servo.period
        for tick in range(round(self.config.time_limit / period) + 1):
            step, row = self._tick(tick * period, any(o.wants_image(tick) for o in observers))
            rows.append(row)
            for observer in observers:
                observer.see(tick, step)
            touched = touched or self.plant.touched
            arrival = arrival.seen(step.state.time, step.error)
            if arrival.is_held and self.episode.scenario.stops_when_reached:
                break
            command = step.command
            self.plant.advance(
                VehicleCommand(command.velocity_body, command.yaw_rate, command.joint_rates),
                period,
            )
        return GuidanceRun(Trace(tuple(rows)), arrival.first, touched)

    def _tick(self, now: float, wants_image: bool) -> tuple[GuidanceStep, Row]:
        state = replace(self.plant.state(), time=now)
        T_world_obj = self.episode.world.T_world_obj(state.time)
        T_cam_obj = invert_transform(state.T_world_cam) @ T_world_obj
        exposure = None
        if wants_image or self.poses.needs_image(state.time):
            exposure = self.camera.expose(state)
        self._take(self.poses.estimate(state.time, exposure, T_cam_obj), T_cam_obj)
        self._deliver(state.time)
        reading = self.plant.read()
        command = self._command(state, reading)
        error = goal_error(T_cam_obj, self.goal, self.symmetric)
        step = GuidanceStep(state, T_cam_obj, error, self.latest, command, exposure)
        return step, self._row(step, reading)

    def _take(self, estimate: PoseEstimate | None, T_cam_obj: Float[np.ndarray, "4 4"]) -> None:
        if estimate is not None:
            self.pending.append(estimate)
            self.truth_at[estimate.stamp] = T_cam_obj

    def _deliver(self, now: float) -> None:
        ready = [estimate for estimate in self.pending if estimate.due <= now + 1e-9]
        if ready:
            self.latest = ready[-1]
            self.pending = [estimate for estimate in self.pending if estimate not in ready]

    def _command(self, state: VehicleState, reading: OnboardReading) -> ServoCommand:
        latest = self.latest
        return self.servo.step(
            None if latest is None else latest.T_cam_obj,
            self.goal,
            reading.joints,
            reading.tilt_rates,
            state.time if latest is None else latest.stamp,
            now=state.time,
            symmetric=self.symmetric,
            confidence=1.0 if latest is None else latest.confidence,
            track_state=None if latest is None else latest.state,
            velocity_body=reading.velocity_body,
            yaw_rate=reading.yaw_rate,
            joint_rates=reading.joint_rates,
            height=reading.height,
        )

    def _row(self, step: GuidanceStep, reading: OnboardReading) -> Row:
        command, latest = step.command, self.latest
        T_estimated = None if latest is None else latest.T_cam_obj
        row: Row = {"time_s": step.state.time}
        flown = VehicleCommand(command.velocity_body, command.yaw_rate, command.joint_rates)
        row |= vehicle_signals(step.state, reading, flown)
        row |= pose_signals("true", step.T_cam_obj, step.error)
        estimated = goal_error(T_estimated, self.goal, self.symmetric)
        row |= pose_signals("estimated", T_estimated, estimated)
        angle, distance = np.nan, np.nan
        if latest is not None:
            truth = self.truth_at[latest.stamp]
            angle, distance = tracking_error(latest.T_cam_obj, truth, self.symmetric)
        row |= {"tracking_error_rad": angle, "tracking_error_m": distance}
        row["image_age_s"] = np.nan if latest is None else step.state.time - latest.stamp
        row["tracker_ms"] = np.nan if latest is None else latest.compute_ms
        row["confidence"] = np.nan if latest is None else latest.confidence
        row["track_state"] = "none" if latest is None else latest.state.value
        row["servo_state"] = command.state.value
        return row


def _make_plant(
    episode: Episode, manipulator: AerialManipulator, config: PlantConfig
) -> AerialPlant:
    return AerialPlant(
        manipulator,
        replace(config, wind=episode.scenario.wind),
        episode.world.surfaces,
        episode.T_world_body,
        episode.joints,
        np.random.default_rng([episode.seed, 3]),
    )
