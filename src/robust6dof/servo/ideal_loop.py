"""The closed loop without dynamics, delay or noise: what a law does by itself.

The vehicle stays level and follows its commands at once, the arm too, and the pose is true. The
measured errors of such a loop are to follow their analytic exponentials.
`python -m robust6dof.servo.ideal_loop` prints the laws' comparison.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from robust6dof.geometry.transforms import invert_transform, make_transform, rotation_about_y
from robust6dof.robot.aerial_manipulator import AerialManipulator, default_aerial_manipulator
from robust6dof.robot.reachability import UP_WORLD, reach_view
from robust6dof.servo.goal import look_down_goal
from robust6dof.servo.pad_servo import PadServo, PadServoConfig, ServoCommand

R_WORLD_UPRIGHT = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
"""An upright object's rotation in the world: its y axis is up."""


@dataclass(frozen=True, eq=False)
class Start:
    """Where a loop begins; the vehicle hovers level at the world's origin."""

    joints: Float[np.ndarray, "N"]
    T_cam_obj: Float[np.ndarray, "4 4"]


@dataclass(frozen=True, eq=False)
class IdealRun:
    """What was seen and commanded at every step."""

    times: Float[np.ndarray, "T"]
    """[s]"""
    T_cam_obj: Float[np.ndarray, "T 4 4"]
    joints: Float[np.ndarray, "T N"]
    commands: tuple[ServoCommand, ...]

    @property
    def translation_errors(self) -> Float[np.ndarray, "T"]:
        """‖T − T*‖ [m]."""
        return np.array([command.translation_error for command in self.commands])

    @property
    def rotation_errors(self) -> Float[np.ndarray, "T"]:
        """θ [rad]."""
        return np.array([command.rotation_error for command in self.commands])

    def time_to(self, delta_T: float, delta_R: float) -> float:
        """First time both errors are below their thresholds [s]; infinite if never."""
        below = (self.translation_errors < delta_T) & (self.rotation_errors < delta_R)
        return float(self.times[np.argmax(below)]) if below.any() else np.inf


def random_start(
    robot: AerialManipulator,
    T_cam_obj_goal: Float[np.ndarray, "4 4"],
    rng: np.random.Generator,
) -> Start:
    """An upright object 0.5–1.5 m farther than the goal, seen 20–60° off straight down, any yaw."""
    tilt = np.radians(rng.uniform(20, 60))
    reach = reach_view(robot, np.array([0.0, -np.sin(tilt), -np.cos(tilt)]))
    R_world_obj = R_WORLD_UPRIGHT @ rotation_about_y(rng.uniform(-np.pi, np.pi))
    Z = T_cam_obj_goal[2, 3] + rng.uniform(0.5, 1.5)
    x, y = rng.uniform(-0.15, 0.15, 2)
    R_cam_world = robot.T_body_cam(reach.joints)[:3, :3].T
    T_cam_obj = make_transform(R_cam_world @ R_world_obj, Z * np.array([x, y, 1.0]))
    return Start(reach.joints, T_cam_obj)


def time_bound(translation_error: float, rotation_error: float, config: PadServoConfig) -> float:
    """max(ln(e_p/δ_T)/λ_p, ln(e_r/δ_R)/λ_r) [s]: what exponential convergence takes."""
    return max(
        np.log(translation_error / config.delta_T) / config.lambda_p,
        np.log(rotation_error / config.delta_R) / config.lambda_r,
        0.0,
    )


def run_ideal(
    servo: PadServo,
    start: Start,
    T_cam_obj_goal: Float[np.ndarray, "4 4"],
    seconds: float,
    *,
    target_velocity: Callable[[float], Float[np.ndarray, "3"]] | None = None,
    target_yaw_rate: float = 0.0,
    symmetric: bool = False,
    stop_when_reached: bool = False,
) -> IdealRun:
    """Integrate vehicle, arm and target under the servo's commands.

    Args:
        seconds: how long.
        target_velocity: of the object over ground at a time, world axes [m/s].
        target_yaw_rate: of the object about the vertical [rad/s].
        stop_when_reached: end with the first step whose state is `reached`.
    """
    servo.start()
    robot, dt = servo.robot, servo.config.period
    joints, T_world_body = start.joints.copy(), np.eye(4)
    T_world_obj = robot.T_body_cam(joints) @ start.T_cam_obj
    times, poses, postures, commands = [], [], [], []
    for step in range(round(seconds / dt)):
        T_cam_obj = invert_transform(T_world_body @ robot.T_body_cam(joints)) @ T_world_obj
        command = servo.step(
            T_cam_obj, T_cam_obj_goal, joints, np.zeros(2), step * dt, symmetric=symmetric
        )
        times.append(step * dt)
        poses.append(T_cam_obj)
        postures.append(joints)
        commands.append(command)
        if stop_when_reached and command.state == "reached":
            break
        T_world_body = T_world_body @ _planar_motion(command.velocity_body, command.yaw_rate, dt)
        joints = joints + command.joint_rates * dt
        velocity = np.zeros(3) if target_velocity is None else target_velocity(step * dt)
        T_world_obj = _move_object(T_world_obj, velocity * dt, target_yaw_rate * dt)
    return IdealRun(np.array(times), np.stack(poses), np.stack(postures), tuple(commands))


def _planar_motion(
    velocity_body: Float[np.ndarray, "3"], yaw_rate: float, dt: float
) -> Float[np.ndarray, "4 4"]:
    """The body's motion under a constant body velocity and yaw rate (exact)."""
    angle = yaw_rate * dt
    # The mean of cos and sin over the turn.
    c, s = np.sinc(angle / np.pi), np.sinc(angle / (2 * np.pi)) ** 2 * angle / 2
    mean_turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    R = Rotation.from_rotvec([0.0, 0.0, angle]).as_matrix()
    return make_transform(R, mean_turn @ velocity_body * dt)


def _move_object(
    T_world_obj: Float[np.ndarray, "4 4"], step: Float[np.ndarray, "3"], turn: float
) -> Float[np.ndarray, "4 4"]:
    R = Rotation.from_rotvec(turn * UP_WORLD).as_matrix()
    return make_transform(R @ T_world_obj[:3, :3], T_world_obj[:3, 3] + step)


def ratios_to_bound(
    servo: PadServo,
    T_cam_obj_goal: Float[np.ndarray, "4 4"],
    seeds: Iterable[int],
    seconds: float = 40.0,
) -> Float[np.ndarray, "R"]:
    """Time to the thresholds over its bound, for each random start; infinite where not reached.

    The starts are those of the default robot, whatever limits the servo's own has.
    """
    robot, config, ratios = default_aerial_manipulator(), servo.config, []
    for seed in seeds:
        start = random_start(robot, T_cam_obj_goal, np.random.default_rng(seed))
        run = run_ideal(servo, start, T_cam_obj_goal, seconds, stop_when_reached=True)
        bound = time_bound(run.translation_errors[0], run.rotation_errors[0], config)
        ratios.append(run.time_to(config.delta_T, config.delta_R) / bound)
    return np.array(ratios)


def unlimited_joints(robot: AerialManipulator) -> AerialManipulator:
    """The robot with joints that turn without end."""
    joints = tuple(replace(joint, lower=-100.0, upper=100.0) for joint in robot.arm.joints)
    return replace(robot, arm=replace(robot.arm, joints=joints))


def main() -> None:
    """Print how long every law takes over the bound, from the same 40 random starts."""
    robot, goal = default_aerial_manipulator(), look_down_goal()
    free = unlimited_joints(robot)
    at_10_hz = PadServoConfig(rate_hz=10, soft_start=0)
    printed = replace(at_10_hz, law="printed")
    rows: list[tuple[str, AerialManipulator, PadServoConfig]] = [
        ("coupled", robot, at_10_hz),
        ("feedforward", robot, replace(at_10_hz, law="feedforward")),
        ("pbvs", robot, replace(at_10_hz, law="pbvs")),
        ("ibvs", robot, replace(at_10_hz, law="ibvs")),
        ("printed, mended rotation", robot, printed),
        ("the same, no joint limits", free, printed),
        ("the same, angular rows", free, replace(printed, rotation_rows="angular")),
        ("printed, printed rotation", free, replace(printed, rotation_error="printed")),
    ]
    print(f"{'law':28}{'reached':>9}{'median':>8}{'worst':>8}")
    for name, of, config in rows:
        ratios = ratios_to_bound(PadServo(of, config), goal, range(40))
        done = ratios[np.isfinite(ratios)]
        figures = f"{np.median(done):8.2f}{done.max():8.2f}" if done.size else f"{'–':>8}{'–':>8}"
        print(f"{name:28}{done.size:>6}/40{figures}", flush=True)


if __name__ == "__main__":
    main()
