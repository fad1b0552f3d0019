"""The servo's settings, the paper's values where it gives them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal, get_args

import numpy as np

from robust6dof.errors import InputError
from robust6dof.servo.safety import SafetyLimits
from robust6dof.servo.target_motion import TargetMotionNoise

Law = Literal["printed", "coupled", "feedforward", "ibvs", "pbvs"]
"""PAD-Servo as printed, with both loops solved as one, and that with the target's velocity fed
forward; image-based and pose-based servoing to compare with."""

LAWS: tuple[Law, ...] = get_args(Law)
"""All of them."""


@dataclass(frozen=True)
class PadServoConfig:
    """Gains, thresholds and readings of PAD-Servo.

    Raises:
        InputError: a gain, threshold or weight that is not positive.
    """

    law: Law = "coupled"
    """Which law turns the errors into commands."""
    lambda_r: float = 0.25
    """Convergence rate of the rotation [1/s] (paper)."""
    lambda_p: float = 0.27
    """Convergence rate of the translation [1/s] (paper)."""
    delta_R: float = 0.075
    """Rotation threshold of the stop test [rad] (paper)."""
    delta_T: float = 0.040
    """Translation threshold of the stop test [m] (paper)."""
    rate_hz: float = 20.0
    """How often the servo is stepped (paper)."""
    hysteresis: float = 1.5
    """Once reached, the goal counts as left when an error exceeds this many thresholds."""
    rotation_error: Literal["camera", "printed"] = "camera"
    """θu of c*R_c in the camera frame, or of the paper's ΔR = R(t)ᵀR* (`printed` law only)."""
    rotation_rows: Literal["all", "angular"] = "all"
    """`printed` law: J_mr⁺ of all six rows with zero linear velocity, or the angular rows alone."""
    vehicle_weight: float = 1.0
    """Cost of the vehicle's linear velocity in the coupled least squares [per (m/s)²]."""
    yaw_weight: float = 0.5
    """Cost of the vehicle's yaw rate [per (rad/s)²]."""
    joint_weight: float = 0.5
    """Cost of a joint's rate [per (rad/s)²]."""
    rest_gain: float = 0.5
    """How fast redundancy pulls the arm to its rest posture [1/s]; no effect on the camera."""
    soft_start: float = 1.0
    """When guidance begins, the law comes into force over this time [s]; 0 for at once."""
    damping: float = 0.05
    """Damping of the pseudo-inverses at a singularity."""
    singular_below: float = 0.08
    """Singular value under which damping sets in."""
    joint_brake: float = 4.0
    """A joint may approach its limit at this rate times the angle left [1/s]."""
    vehicle_lag: float = 0.0
    """How late the vehicle follows a velocity command [s]: the time constant of its velocity
    loop. `feedforward` commands the target's velocity as it will be this much later."""
    shortfall_gain: float = 2.0
    """`feedforward` law: how fast the way that the vehicle has fallen short of is made up [1/s]."""
    max_shortfall: float = 0.15
    """No more of that is remembered [m]."""
    tilt_compensation: Literal["arm", "all"] = "arm"
    """Who makes up for the measured tilt rates in the coupled laws: the arm, which keeps the
    camera's direction, or the vehicle too, as the paper has it (see docs/servo.md)."""
    max_tilt_rate: float = 2.0
    """Measured tilt rates are clipped here before they are compensated [rad/s]."""
    limits: SafetyLimits = field(default_factory=SafetyLimits)
    """What no command exceeds, and when the vehicle holds."""
    noise: TargetMotionNoise = field(default_factory=TargetMotionNoise)
    """What the target-velocity filter assumes (`feedforward` law)."""

    def __post_init__(self) -> None:
        for name in ("lambda_r", "lambda_p", "delta_R", "delta_T", "rate_hz", "damping",
                     "vehicle_weight", "yaw_weight", "joint_weight"):  # fmt: skip
            if not getattr(self, name) > 0:
                raise InputError(
                    f"PadServoConfig.{name} must be positive, got {getattr(self, name)}"
                )
        if self.hysteresis < 1:
            raise InputError(f"PadServoConfig.hysteresis must be at least 1, got {self.hysteresis}")

    def share_in_force(self, readiness: float) -> float:
        """Share of the law's command at a `readiness` of 0 to 1: smooth, with no jump."""
        return 0.5 - 0.5 * float(np.cos(np.pi * readiness))

    @property
    def period(self) -> float:
        """Time between two steps [s]."""
        return 1.0 / self.rate_hz
