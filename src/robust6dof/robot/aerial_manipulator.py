"""A multirotor that carries an arm that carries a camera: frames, Jacobians, limits."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.resources import as_file, files
from pathlib import Path

import numpy as np
from jaxtyping import Float

from robust6dof.geometry.transforms import make_transform
from robust6dof.robot import velocity_transmission as transmission
from robust6dof.robot.arm import Arm
from robust6dof.robot.mjcf import read_mjcf_arm
from robust6dof.robot.urdf import read_urdf_arm
from robust6dof.robot.xml_root import read_xml_root

DEFAULT_ARM = files("robust6dof.robot") / "resources" / "yaw_pitch_pitch_roll.xml"
"""The default arm's description, which the simulation builds from too."""


@dataclass(frozen=True, eq=False)
class AerialManipulator:
    """Kinematics of vehicle, arm and camera. Joint angles in rad, N joints (the paper's 4)."""

    arm: Arm
    T_body_base: Float[np.ndarray, "4 4"]
    """Where the arm is mounted on the vehicle (body frame: x forward, y left, z up)."""

    def T_body_links(self, joints: Float[np.ndarray, "N"]) -> Float[np.ndarray, "N 4 4"]:
        """Every moving link's frame in the body frame."""
        return self.T_body_base @ self.arm.T_base_links(joints)

    def T_body_axes(self, joints: Float[np.ndarray, "N"]) -> Float[np.ndarray, "N 4 4"]:
        """The paper's frames L_i: at the links' origins, z along the joint's axis."""
        return self.T_body_links(joints) @ self.arm.T_links_axes

    def T_body_cam(self, joints: Float[np.ndarray, "N"]) -> Float[np.ndarray, "4 4"]:
        """The camera (OpenCV axes) in the body frame."""
        return self.T_body_base @ self.arm.T_base_cam(joints)

    def camera_jacobian(self, joints: Float[np.ndarray, "N"]) -> Float[np.ndarray, "6 M"]:
        """J of Eq. 3 (6×10 for four joints): V_C = J (ṗ, ω, η̇), all in own axes."""
        T_body_links = self.T_body_links(joints)
        return transmission.camera_jacobian(
            T_body_links[-1] @ self.arm.T_tip_cam, T_body_links @ self.arm.T_links_axes
        )

    def vehicle_jacobian(self, joints: Float[np.ndarray, "N"]) -> Float[np.ndarray, "6 6"]:
        """r̄_C^B of the velocity transmission, its cross product [r]× put back."""
        return self.camera_jacobian(joints)[:, :6]

    def command_jacobian(self, joints: Float[np.ndarray, "N"]) -> Float[np.ndarray, "6 4"]:
        """J_s: the effect of υ = (v_x, v_y, v_z, ω_z) on the camera's velocity."""
        return self.camera_jacobian(joints)[:, transmission.VEHICLE_COLUMNS]

    def tilt_jacobian(self, joints: Float[np.ndarray, "N"]) -> Float[np.ndarray, "6 2"]:
        """J̄_s: the effect of ∇ = (ω_x, ω_y) on the camera's velocity."""
        return self.camera_jacobian(joints)[:, transmission.TILT_COLUMNS]

    def arm_jacobian(self, joints: Float[np.ndarray, "N"]) -> Float[np.ndarray, "6 N"]:
        """J_m: joint rates to the camera's velocity expressed in the body frame."""
        R_body_cam = self.T_body_cam(joints)[:3, :3]
        return np.kron(np.eye(2), R_body_cam) @ self.camera_arm_jacobian(joints)

    def camera_arm_jacobian(self, joints: Float[np.ndarray, "N"]) -> Float[np.ndarray, "6 N"]:
        """J_mr = diag(R_cam_body, R_cam_body) J_m: joint rates to V_C."""
        return self.camera_jacobian(joints)[:, 6:]

    def manipulability(self, joints: Float[np.ndarray, "N"]) -> float:
        """Yoshikawa's measure √det(J Jᵀ) of the arm's angular Jacobian; 0 where rank < 3."""
        J = self.camera_arm_jacobian(joints)[3:]
        return float(np.sqrt(max(np.linalg.det(J @ J.T), 0.0)))

    def rotation_rank(self, joints: Float[np.ndarray, "N"], tolerance: float = 1e-6) -> int:
        """How many directions the arm alone can turn the camera in (3, or 2 for some arms)."""
        return int(np.linalg.matrix_rank(self.camera_arm_jacobian(joints)[3:], tol=tolerance))

    def within_limits(self, joints: Float[np.ndarray, "N"], slack: float = 0.0) -> bool:
        """Whether every joint is inside its range, give or take `slack` [rad]."""
        low, high = self.arm.lower - slack, self.arm.upper + slack
        return bool(np.all((joints >= low) & (joints <= high)))


def default_aerial_manipulator() -> AerialManipulator:
    """The default arm; its camera rests looking straight down."""
    with as_file(DEFAULT_ARM) as path:
        return _mounted(read_mjcf_arm(path))


def read_aerial_manipulator(path: str | Path) -> AerialManipulator:
    """One's own arm, from URDF or MJCF, its base 6 cm below the body's origin.

    The base's axes are the body's (x forward, y left, z up): the file describes an arm that hangs.
    The camera is the URDF's link `camera_optical_frame` or the MJCF's site `camera`.

    Raises:
        DataError: neither format, or outside the subset that `read_urdf_arm` and `read_mjcf_arm`
            read.
    """
    path = Path(path)
    root = read_xml_root(path, "the arm as URDF or MJCF")
    read = read_urdf_arm if root.tag == "robot" else read_mjcf_arm
    return _mounted(read(path, root=root))


def _mounted(arm: Arm, R_body_base: Float[np.ndarray, "3 3"] | None = None) -> AerialManipulator:
    """With the arm's base 6 cm below the body's origin; its axes are the body's if not given."""
    R = np.eye(3) if R_body_base is None else R_body_base
    return AerialManipulator(arm, make_transform(R, np.array([0.0, 0.0, -0.06])))


def open_manipulator_x(mjcf_path: str | Path) -> AerialManipulator:
    """ROBOTIS' OpenMANIPULATOR-X hung below the vehicle, a camera ahead of its gripper.

    Its joints are yaw, pitch, pitch, pitch, so its angular Jacobian has rank 2: the camera can
    look anywhere but not roll about the horizontal axis in the arm's plane. Reachability says
    which goals it serves.

    Args:
        mjcf_path: `open_manipulator_x.xml` of ROBOTIS' menagerie.
    """
    # The camera looks along the hand (link5's x); hung upside down, link5's z is image down.
    R_tip_cam = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    arm = read_mjcf_arm(
        Path(mjcf_path),
        tip="link5",
        T_tip_cam=make_transform(R_tip_cam, np.array([0.06, 0.0, -0.05])),
        rest=np.array([0.0, -0.5, -0.2, -0.87]),
        max_rate=2.5,
    )
    return _mounted(arm, R_body_base=np.diag([1.0, -1.0, -1.0]))
