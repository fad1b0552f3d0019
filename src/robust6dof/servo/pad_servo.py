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
from robust6dof.servo.ibvs import ibvs_law
from robust6dof.servo.interaction import rotation_error_vector
from robust6dof.servo.laws import Sight, coupled_law, printed_law
from robust6dof.servo.memory import ServoMemory, admit
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
class _Reading:
    """The vehicle's own state at one step."""

    joints: Float[np.ndarray, "N"]
    tilt_rates: Float[np.ndarray, "2"]
    J: Float[np.ndarray, "6 M"]
    camera_twist: Float[np.ndarray, "6"]
    height: float | None
    now: float


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
        own = _own_motion(self.memory, velocity_body, yaw_rate, joint_rates)
        reading = _read(self.robot, self.config, joints, tilt_rates, own, height, now)
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
        self, T_cam_obj_goal: Float[np.ndarray, "4 4"], reading: _Reading, symmetric: bool
    ) -> ServoCommand:
        T_cam_obj = self.memory.T_cam_obj
        sight = Sight(
            T_cam_obj, T_cam_obj_goal, reading.joints, reading.tilt_rates, reading.J, symmetric
        )
        command, target_velocity = self._law(sight)
        command = self._make_safe(command, sight, reading)
        translation, rotation = _errors(T_cam_obj, T_cam_obj_goal, symmetric)
        state = self._stop_test(translation, rotation)
        self.memory = replace(
            self.memory, command=command, command_time=reading.now, reached=state == "reached"
        )
        return ServoCommand(
            command[:3], float(command[3]), command[4:], state, translation, rotation,
            target_velocity,
        )  # fmt: skip

    def _law(self, sight: Sight) -> tuple[Float[np.ndarray, "M"], Float[np.ndarray, "3"]]:
        """The law's bare command, and the target's velocity in body axes that it used."""
        still = np.zeros(3)
        match self.config.law:
            case "printed":
                return printed_law(self.robot, sight, self.config), still
            case "ibvs":
                return ibvs_law(self.robot, sight, self.config), still
            case "pbvs":
                return pbvs_law(self.robot, sight, self.config), still
            case "coupled":
                return coupled_law(self.robot, sight, self.config), still
            case "feedforward":
                T_now, twist = self.memory.target_now(self.config, symmetric=sight.symmetric)
                sight = replace(sight, T_cam_obj=T_now)
                R_body_cam = self.robot.T_body_cam(sight.joints)[:3, :3]
                command = coupled_law(self.robot, sight, self.config, twist)
                return command, R_body_cam @ twist[:3]

    def _make_safe(
        self, command: Float[np.ndarray, "M"], sight: Sight, reading: _Reading
    ) -> Float[np.ndarray, "M"]:
        limits, max_rates = self.config.limits, self.robot.arm.max_rates
        elapsed = reading.now - self.memory.command_time
        dt = float(np.clip(elapsed, 0.0, 2 * self.config.period)) or self.config.period
        command = saturate(command, max_rates, limits)
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
        self.memory = replace(self.memory, command=np.zeros(4 + n), reached=False)
        return ServoCommand(np.zeros(3), 0.0, np.zeros(n), state, np.nan, np.nan, np.zeros(3))


def _check_goal(T_cam_obj_goal: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "4 4"]:
    T_cam_obj_goal = check_transform(T_cam_obj_goal, "T_cam_obj_goal")
    if T_cam_obj_goal[2, 3] <= 0:
        raise InputError("T_cam_obj_goal puts the object behind the camera; its z must be positive")
    return T_cam_obj_goal


def _own_motion(
    memory: ServoMemory,
    velocity_body: np.ndarray | None,
    yaw_rate: float | None,
    joint_rates: np.ndarray | None,
) -> Float[np.ndarray, "M"]:
    """(v, ω_z, η̇) as measured, else as commanded."""
    own = memory.command.copy()
    if velocity_body is not None:
        own[:3] = velocity_body
    if yaw_rate is not None:
        own[3] = yaw_rate
    if joint_rates is not None:
        own[4:] = joint_rates
    return own


def _read(
    robot: AerialManipulator,
    config: PadServoConfig,
    joints: np.ndarray,
    tilt_rates: np.ndarray,
    own: np.ndarray,
    height: float | None,
    now: float,
) -> _Reading | None:
    """The readings, checked and clipped; None where one is not finite."""
    values = np.concatenate([joints, tilt_rates, own, [now, 0.0 if height is None else height]])
    if not np.isfinite(values).all():
        return None
    tilt_rates = np.clip(tilt_rates, -config.max_tilt_rate, config.max_tilt_rate)
    J = robot.camera_jacobian(joints)
    camera_twist = J @ np.concatenate([own[:3], tilt_rates, own[3:]])
    return _Reading(joints, tilt_rates, J, camera_twist, height, now)


def _errors(
    T_cam_obj: np.ndarray, T_cam_obj_goal: np.ndarray, symmetric: bool
) -> tuple[float, float]:
    theta_u = rotation_error_vector(T_cam_obj[:3, :3], T_cam_obj_goal[:3, :3], symmetric=symmetric)
    offset = T_cam_obj[:3, 3] - T_cam_obj_goal[:3, 3]
    return float(np.linalg.norm(offset)), float(np.linalg.norm(theta_u))
