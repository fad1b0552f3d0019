"""Whether the limits held in a flight, read from its trace."""

from __future__ import annotations

import numpy as np

from robust6dof.robot.arm import Arm
from robust6dof.simulation.guidance import GuidanceConfig
from robust6dof.simulation.trace import Trace

TILT_SLACK = np.deg2rad(3.0)
"""The flight controller limits the tilt it asks for; the vehicle may swing this much over."""

PLACE_SLACK = 0.05
"""Height and distance limit commands: latency and wind may carry the vehicle this far over [m]."""

JOINT_SLACK = np.deg2rad(2.0)
"""A joint's stop gives way this much in MuJoCo [rad]."""


def broken_limits(trace: Trace, config: GuidanceConfig, arm: Arm) -> tuple[str, ...]:
    """Names of the limits that did not hold at some moment.

    Commanded: `speed`, `yaw_rate`, `joint_rate`, exactly. Flown, judged on the truth: `tilt`,
    `height`, `distance` (camera to object), `joint_range`, with the slacks stated above.
    """
    limits = config.servo.limits
    joints = trace.columns(*(f"joint{i}_rad" for i in range(1, 5)))
    rates = trace.columns(*(f"joint{i}_rate_cmd_rad_s" for i in range(1, 5)))
    max_rates = np.minimum(arm.max_rates, limits.max_joint_rate)
    speed = np.linalg.norm(trace.columns("vx_cmd_m_s", "vy_cmd_m_s", "vz_cmd_m_s"), axis=1)
    distance = np.linalg.norm(trace.columns("true_obj_x_m", "true_obj_y_m", "true_obj_z_m"), axis=1)
    up = np.cos(trace.column("roll_rad")) * np.cos(trace.column("pitch_rad"))
    height = trace.column("z_m")
    tilt_limit = config.plant.autopilot.max_tilt + TILT_SLACK
    broken = {
        "speed": speed > limits.max_speed + 1e-9,
        "yaw_rate": np.abs(trace.column("wz_cmd_rad_s")) > limits.max_yaw_rate + 1e-9,
        "joint_rate": np.abs(rates) > max_rates + 1e-9,
        "tilt": up < np.cos(tilt_limit),
        "height": (height < limits.min_height - PLACE_SLACK)
        | (height > limits.max_height + PLACE_SLACK),
        "distance": distance < limits.min_distance - PLACE_SLACK,
        "joint_range": (joints < arm.lower - JOINT_SLACK) | (joints > arm.upper + JOINT_SLACK),
    }
    return tuple(name for name, where in broken.items() if np.any(where))
