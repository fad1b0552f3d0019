"""A serial arm of revolute joints with a camera in its hand, as data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from robust6dof.errors import InputError
from robust6dof.geometry.transforms import make_transform, skew, transform_points


@dataclass(frozen=True, eq=False)
class Joint:
    """A revolute joint and where it sits on the link before it."""

    name: str
    T_parent_joint: Float[np.ndarray, "4 4"]
    """The joint's frame in its parent's, at zero angle."""
    axis: Float[np.ndarray, "3"]
    """Unit vector in the joint's frame."""
    lower: float
    """Limit of the angle [rad]."""
    upper: float
    """Limit of the angle [rad]."""
    max_rate: float
    """Limit of the speed, either way [rad/s]."""
    max_torque: float = np.inf
    """Limit of the torque, either way [N·m]."""


@dataclass(frozen=True, eq=False)
class Link:
    """A rigid body of the arm; its frame is that of the joint that moves it."""

    name: str
    mass: float
    """[kg]"""
    center_of_mass: Float[np.ndarray, "3"]
    """In the link's frame [m]."""
    inertia: Float[np.ndarray, "3 3"]
    """About the centre of mass, along the link's axes [kg·m²]."""


@dataclass(frozen=True, eq=False)
class Arm:
    """A chain of joints from a base to a camera.

    Raises:
        InputError: no joint, or a joint whose limits leave it no room.
    """

    name: str
    base: Link
    joints: tuple[Joint, ...]
    links: tuple[Link, ...]
    """The moving links, one for each joint."""
    T_tip_cam: Float[np.ndarray, "4 4"]
    """The camera (OpenCV axes) in the last link's frame."""
    rest: Float[np.ndarray, "N"]
    """The posture [rad] that redundancy pulls towards."""

    def __post_init__(self) -> None:
        if not self.joints or len(self.joints) != len(self.links):
            raise InputError(f"arm {self.name}: needs at least one joint, and a link for each")
        for joint in self.joints:
            if not joint.lower < joint.upper or joint.max_rate <= 0:
                raise InputError(
                    f"arm {self.name}, joint {joint.name}: limits {joint.lower} to {joint.upper} "
                    f"rad at {joint.max_rate} rad/s leave no motion"
                )
            if not np.isclose(np.linalg.norm(joint.axis), 1.0):
                raise InputError(f"arm {self.name}, joint {joint.name}: the axis is no unit vector")

    @cached_property
    def _mounts(self) -> Float[np.ndarray, "N 4 4"]:
        return np.stack([joint.T_parent_joint for joint in self.joints])

    @cached_property
    def _axes(self) -> Float[np.ndarray, "N 3"]:
        return np.stack([joint.axis for joint in self.joints])

    @cached_property
    def T_links_axes(self) -> Float[np.ndarray, "N 4 4"]:
        """The paper's frames L_i in the links': same origin, z along the joint's axis."""
        return np.stack([make_transform(_frame_about(axis), np.zeros(3)) for axis in self._axes])

    @cached_property
    def lower(self) -> Float[np.ndarray, "N"]:
        """Lower limits [rad]."""
        return np.array([joint.lower for joint in self.joints])

    @cached_property
    def upper(self) -> Float[np.ndarray, "N"]:
        """Upper limits [rad]."""
        return np.array([joint.upper for joint in self.joints])

    @cached_property
    def max_rates(self) -> Float[np.ndarray, "N"]:
        """Limits of the joint rates, either way [rad/s]."""
        return np.array([joint.max_rate for joint in self.joints])

    @property
    def mass(self) -> float:
        """Mass of the arm with its base and camera [kg]."""
        return self.base.mass + sum(link.mass for link in self.links)

    def T_base_links(self, joints: Float[np.ndarray, "N"]) -> Float[np.ndarray, "N 4 4"]:
        """Forward kinematics: every moving link's frame in the arm's base.

        Raises:
            InputError: as many angles as joints are needed.
        """
        if joints.shape != (len(self.joints),):
            raise InputError(
                f"arm {self.name} has {len(self.joints)} joints, got angles {joints.shape}"
            )
        steps = self._mounts.copy()
        turns = Rotation.from_rotvec(joints[:, None] * self._axes).as_matrix()
        steps[:, :3, :3] = steps[:, :3, :3] @ turns
        for i in range(1, len(steps)):
            steps[i] = steps[i - 1] @ steps[i]
        return steps

    def T_base_cam(self, joints: Float[np.ndarray, "N"]) -> Float[np.ndarray, "4 4"]:
        """The camera in the arm's base."""
        return self.T_base_links(joints)[-1] @ self.T_tip_cam


@dataclass(frozen=True, eq=False)
class Segment:
    """One body of a chain as a model file lists it, fixed to the one before or jointed."""

    T_parent_body: Float[np.ndarray, "4 4"]
    link: Link
    joint: Joint | None
    """None where the body is fixed; its mass then goes to the link it is fixed to."""


def build_arm(
    name: str,
    base: Link,
    segments: Sequence[Segment],
    T_tip_cam: Float[np.ndarray, "4 4"],
    max_rates: Float[np.ndarray, "N"] | None = None,
    rest: Float[np.ndarray, "N"] | None = None,
) -> Arm:
    """Put a chain of bodies together.

    Args:
        T_tip_cam: the camera in the last body's frame.
        max_rates: limits of the joint rates [rad/s]; the joints' own where None.
        rest: posture to rest in [rad]; the middle of the ranges where None.
    """
    joints: list[Joint] = []
    links = [base]
    T_link_body = np.eye(4)
    for segment in segments:
        T_link_body = T_link_body @ segment.T_parent_body
        if segment.joint is None:
            links[-1] = merge_links(links[-1], segment.link, T_link_body)
            continue
        joints.append(replace(segment.joint, T_parent_joint=T_link_body))
        links.append(segment.link)
        T_link_body = np.eye(4)
    if max_rates is not None:
        joints = [replace(j, max_rate=float(r)) for j, r in zip(joints, max_rates, strict=True)]
    if rest is None:
        rest = np.array([(joint.lower + joint.upper) / 2 for joint in joints])
    return Arm(name, links[0], tuple(joints), tuple(links[1:]), T_link_body @ T_tip_cam, rest)


def merge_links(link: Link, fixed: Link, T_link_fixed: Float[np.ndarray, "4 4"]) -> Link:
    """One rigid body of a link and another fixed to it (parallel axis theorem)."""
    mass = link.mass + fixed.mass
    if mass == 0:
        return link
    R = T_link_fixed[:3, :3]
    com_fixed = transform_points(T_link_fixed, fixed.center_of_mass)
    com = (link.mass * link.center_of_mass + fixed.mass * com_fixed) / mass
    inertia = link.inertia + R @ fixed.inertia @ R.T
    for part_mass, part_com in ((link.mass, link.center_of_mass), (fixed.mass, com_fixed)):
        arm = skew(part_com - com)
        inertia = inertia - part_mass * arm @ arm
    return Link(link.name, mass, com, inertia)


def _frame_about(axis: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3 3"]:
    """A rotation whose third column is `axis`."""
    helper = np.eye(3)[int(np.argmin(np.abs(axis)))]
    x = np.cross(helper, axis)
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(axis, x), axis], axis=1)
