"""PAD-Servo: the object's pose in the camera → velocities for the vehicle and its arm.

servo = PadServo(default_aerial_manipulator())
command = servo.step(T_cam_obj, T_cam_obj_goal, joints, tilt_rates, stamp)
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float

from robust6dof.errors import InputError
from robust6dof.frames import TrackState
from robust6dof.geometry.transforms import check_transform
from robust6dof.robot.aerial_manipulator import AerialManipulator
from robust6dof.servo.config import PadServoConfig
from robust6dof.servo.following import Following
from robust6dof.servo.ibvs import ibvs_law
from robust6dof.servo.laws import Sight, coupled_law, printed_law
from robust6dof.servo.memory import ServoMemory, admit
from robust6dof.servo.own_reading import OwnReading, read_own
from robust6dof.servo.pbvs import pbvs_law
from robust6dof.servo.safety import ServoState, keep_clear, limit_acceleration, saturate


@dataclass(frozen=True, eq=False)
class ServoCommand:
    """What the vehicle and the arm shall do until the next command."""

    velocity_body: Float[np.ndarray, "3"]
    """Of the vehicle, in its body frame (x forward, y left, z up) [m/s]."""
    yaw_rate: float
    """ω_z of the vehicle, counter-clockwise from above [rad/s]."""
    joint_rates: Float[np.ndarray, "N"]
    """[rad/s]"""
    state: ServoState
    translation_error: float
    """‖T − T*‖ as seen by the camera [m]; NaN without a usable pose."""
    rotation_error: float
    """Angle between the rotation and its goal [rad] (of the axis, where symmetric); or NaN."""
    target_velocity: Float[np.ndarray, "3"]
    """Of the target over ground, body axes [m/s]: the filter's estimate (`feedforward` only)."""

    @property
    def as_vector(self) -> Float[np.ndarray, "M"]:
        """(v_x, v_y, v_z, ω_z, joint rates)."""
        return np.concatenate([self.velocity_body, [self.yaw_rate], self.joint_rates])


@dataclass(frozen=True, eq=False)
class _Target:
    """The target's motion over ground, body axes."""

    velocity: Float[np.ndarray, "3"]
    acceleration: Float[np.ndarray, "3"]


@dataclass
class PadServo:
    """Guides the camera of an aerial manipulator to a pose relative to an object.

    It carries one immutable memory from step to step: the last believed pose, the last command,
    the target's motion. `start()` forgets it.
    """

    robot: AerialManipulator
    config: PadServoConfig = field(default_factory=PadServoConfig)
    memory: ServoMemory = field(init=False)

    def __post_init__(self) -> None:
        self.start()

    def start(self) -> None:
        """Forget the past: the next step is the first."""
        self.memory = ServoMemory.blank(len(self.robot.arm.joints))

    def step(
        self,
        T_cam_obj: Float[np.ndarray, "4 4"] | None,
        T_cam_obj_goal: Float[np.ndarray, "4 4"],
        joints: Float[np.ndarray, "N"],
        tilt_rates: Float[np.ndarray, "2"],
        stamp: float,
        *,
        now: float | None = None,
        symmetric: bool = False,
        confidence: float = 1.0,
        track_state: TrackState | None = None,
        velocity_body: Float[np.ndarray, "3"] | None = None,
        yaw_rate: float | None = None,
        joint_rates: Float[np.ndarray, "N"] | None = None,
        height: float | None = None,
    ) -> ServoCommand:
        """One command from one pose. Never raises on a bad pose or reading: it holds and says why.

        Args:
            T_cam_obj: the object's pose in the camera as tracked; None where there is none.
            T_cam_obj_goal: where it should be.
            joints: measured joint angles [rad].
            tilt_rates: measured (ω_x, ω_y) of the vehicle, body frame [rad/s].
            stamp: when the image of T_cam_obj was taken [s].
            now: the time of this step on the same clock [s]. Where not given, it is the stamp, or
                one period after the last step when the same image comes again.
            symmetric: turns of the object about its y axis mean nothing.
            confidence: the tracker's, 0 to 1.
            track_state: the tracker's.
            velocity_body, yaw_rate, joint_rates: measured own motion [m/s, rad/s], for the
                target's velocity; what was commanded where not given.
            height: of the vehicle above ground [m], where known.

        Raises:
            InputError: the goal is no rigid transform in front of the camera.
        """
        T_cam_obj_goal = _check_goal(T_cam_obj_goal)
        trusted = confidence >= self.config.limits.min_confidence and track_state not in (
            TrackState.LOST,
            TrackState.RECOVERING,
        )
        if now is None:
            now = stamp if stamp > self.memory.now else self.memory.now + self.config.period
        motion = (velocity_body, yaw_rate, joint_rates)
        reading = read_own(self.robot, self.config, self.memory.command, joints, tilt_rates,
                           motion, height, now)  # fmt: skip
        if reading is None:
            return self._hold(ServoState.HOLD_INVALID)
        self.memory, refusal = admit(
            self.memory,
            T_cam_obj if trusted else None,
            stamp,
            now,
            reading.camera_twist,
            self.config,
            symmetric=symmetric,
        )
        if refusal is not None:
            return self._hold(refusal)
        return self._guide(T_cam_obj_goal, reading, symmetric)

    def _guide(
        self, T_cam_obj_goal: Float[np.ndarray, "4 4"], reading: OwnReading, symmetric: bool
    ) -> ServoCommand:
        T_cam_obj = self.memory.T_cam_obj
        sight = Sight(
            T_cam_obj, T_cam_obj_goal, reading.joints, reading.tilt_rates, reading.J, symmetric
        )
        self._account(reading)
        wanted, target = self._law(sight)
        wanted *= self.config.share_in_force(self.memory.readiness)
        asked = self._ahead(wanted, target, reading)
        command = self._make_safe(asked, sight, reading)
        translation = float(np.linalg.norm(T_cam_obj[:3, 3] - T_cam_obj_goal[:3, 3]))
        rotation = float(np.linalg.norm(sight.rotation_error))
        state = self._stop_test(translation, rotation)
        # What the limits take back is not wanted: the vehicle owes it to nobody.
        following = replace(self.memory.following, wanted=(wanted + command - asked)[:3])
        self.memory = replace(
            self.memory, command=command, command_time=reading.now, following=following,
            reached=state == "reached",
        )  # fmt: skip
        return ServoCommand(
            command[:3], float(command[3]), command[4:], state, translation, rotation,
            target.velocity,
        )  # fmt: skip

    def _account(self, reading: OwnReading) -> None:
        """Take in what the vehicle did since the last step."""
        dt, following = self._elapsed(reading.now), self.memory.following
        if reading.velocity is not None:
            limit = self.config.max_shortfall
            following = following.moved(reading.velocity, reading.yaw_rate, dt, limit)
        readiness = min(1.0, self.memory.readiness + dt / max(self.config.soft_start, 1e-6))
        self.memory = replace(self.memory, following=following, readiness=readiness)

    def _law(self, sight: Sight) -> tuple[Float[np.ndarray, "M"], _Target]:
        """The law's bare command, and the target's motion that it used."""
        config, still = self.config, _Target(np.zeros(3), np.zeros(3))
        match config.law:
            case "printed":
                return printed_law(self.robot, sight, config), still
            case "ibvs":
                return ibvs_law(self.robot, sight, config), still
            case "pbvs":
                return pbvs_law(self.robot, sight, config), still
            case "coupled":
                return coupled_law(self.robot, sight, config), still
            case "feedforward":
                T_now, twist, a = self.memory.target_now(config, symmetric=sight.symmetric)
                sight = replace(sight, T_cam_obj=T_now)
                R_body_cam = self.robot.T_body_cam(sight.joints)[:3, :3]
                target = _Target(R_body_cam @ twist[:3], R_body_cam @ a)
                return coupled_law(self.robot, sight, config, twist), target

    def _ahead(
        self, wanted: Float[np.ndarray, "M"], target: _Target, reading: OwnReading
    ) -> Float[np.ndarray, "M"]:
        """What to ask of a vehicle that follows late (`feedforward` only)."""
        if self.config.law != "feedforward":
            return wanted
        velocity = self.memory.following.command(
            wanted[:3], target.velocity, target.acceleration, reading.yaw_rate, self.config
        )
        return np.concatenate([velocity, wanted[3:]])

    def _elapsed(self, now: float) -> float:
        """Time since the last command, at most two periods [s]; one before the first."""
        elapsed, period = now - self.memory.command_time, self.config.period
        return min(elapsed, 2 * period) if 0 < elapsed < np.inf else period

    def _make_safe(
        self, command: Float[np.ndarray, "M"], sight: Sight, reading: OwnReading
    ) -> Float[np.ndarray, "M"]:
        limits, max_rates = self.config.limits, self.robot.arm.max_rates
        command = saturate(command, max_rates, limits)
        dt = self._elapsed(reading.now)
        command = limit_acceleration(command, self.memory.command[:3], dt, limits)
        J_command = np.hstack([sight.J_s, sight.J_mr])[:3]
        t_cam_obj = self.memory.T_cam_obj[:3, 3]
        command = keep_clear(command, t_cam_obj, J_command, reading.height, limits)
        return saturate(command, max_rates, limits)

    def _stop_test(self, translation: float, rotation: float) -> ServoState:
        """Both errors below their thresholds; left only beyond `hysteresis` times either."""
        slack = self.config.hysteresis if self.memory.reached else 1.0
        reached = (
            translation < slack * self.config.delta_T and rotation < slack * self.config.delta_R
        )
        return ServoState.REACHED if reached else ServoState.GUIDING

    def _hold(self, state: ServoState) -> ServoCommand:
        n = len(self.robot.arm.joints)
        lost = self.config.period / max(self.config.soft_start, 1e-6)
        self.memory = replace(
            self.memory, command=np.zeros(4 + n), command_time=self.memory.now,
            following=Following.none(),
            readiness=max(0.0, self.memory.readiness - lost), reached=False,
        )  # fmt: skip
        return ServoCommand(np.zeros(3), 0.0, np.zeros(n), state, np.nan, np.nan, np.zeros(3))


def _check_goal(T_cam_obj_goal: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "4 4"]:
    T_cam_obj_goal = check_transform(T_cam_obj_goal, "T_cam_obj_goal")
    if T_cam_obj_goal[2, 3] <= 0:
        raise InputError("T_cam_obj_goal puts the object behind the camera; its z must be positive")
    return T_cam_obj_goal
