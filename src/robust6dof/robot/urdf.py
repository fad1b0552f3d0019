"""Read an arm from URDF, ROS' model format.

The subset: `joint`s of type `revolute` or `fixed` with `origin`, `axis` and
`limit lower upper velocity effort`, `link`s with `inertial`. The chain runs from the root link to
the camera's link, whose frame must have OpenCV axes (ROS calls it an optical frame). Branches
(a gripper) and their mass are left out. The first link is the arm's base.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from robust6dof.errors import DataError
from robust6dof.geometry.transforms import make_transform
from robust6dof.robot.arm import Arm, Joint, Link, Segment, build_arm
from robust6dof.robot.xml_root import read_xml_root


def read_urdf_arm(
    path: str | Path,
    *,
    root: ET.Element | None = None,
    camera: str = "camera_optical_frame",
    rest: Float[np.ndarray, "N"] | None = None,
) -> Arm:
    """Read the chain from the root link to the camera's.

    Args:
        path: the URDF file (not xacro).
        root: the file's root, where it is parsed already.
        camera: the link whose frame is the camera's, OpenCV axes.
        rest: the posture to rest in [rad]; else the middle of the ranges.

    Raises:
        DataError: unreadable XML, no such link, a joint that is neither revolute nor fixed or has
            no limits.
    """
    path = Path(path)
    root = read_xml_root(path, "a URDF file") if root is None else root
    links = {link.get("name", ""): link for link in root.findall("link")}
    if root.tag != "robot" or camera not in links:
        raise DataError(path, f"no link '{camera}'", f"It has {', '.join(links) or 'no links'}")
    chain = _chain(root, camera)
    base = _parent(chain[0]) if chain else camera
    segments = [_segment(path, joint, links) for joint in chain]
    name = root.get("name", path.stem)
    return build_arm(name, _link(links[base]), segments, np.eye(4), rest=rest)


def _chain(root: ET.Element, tip: str) -> list[ET.Element]:
    """Joints from the root link to `tip`."""
    joint_to = {_child(joint): joint for joint in root.findall("joint")}
    chain: list[ET.Element] = []
    while tip in joint_to:
        chain.insert(0, joint_to[tip])
        tip = _parent(chain[0])
    return chain


def _child(joint: ET.Element) -> str:
    return joint.find("child").get("link", "")  # pyright: ignore[reportOptionalMemberAccess]


def _parent(joint: ET.Element) -> str:
    return joint.find("parent").get("link", "")  # pyright: ignore[reportOptionalMemberAccess]


def _segment(path: Path, joint: ET.Element, links: dict[str, ET.Element]) -> Segment:
    T_parent_body = _origin(joint.find("origin"))
    link = _link(links[_child(joint)])
    if joint.get("type") == "fixed":
        return Segment(T_parent_body, link, None)
    name, limit = joint.get("name", ""), joint.find("limit")
    if joint.get("type") != "revolute" or limit is None:
        raise DataError(
            path, f"joint '{name}' is {joint.get('type')}", "Only limited revolute joints are read"
        )
    axis_element = joint.find("axis")
    axis = _numbers("1 0 0" if axis_element is None else axis_element.get("xyz", "1 0 0"))
    lower, upper, velocity, effort = (
        float(limit.get(key, "0")) for key in ("lower", "upper", "velocity", "effort")
    )
    unit = axis / np.linalg.norm(axis)
    hinge = Joint(name, T_parent_body, unit, lower, upper, velocity, effort or np.inf)
    return Segment(T_parent_body, link, hinge)


def _link(link: ET.Element) -> Link:
    name, inertial = link.get("name", ""), link.find("inertial")
    if inertial is None:
        return Link(name, 0.0, np.zeros(3), np.zeros((3, 3)))
    T_link_com = _origin(inertial.find("origin"))
    mass, moments = inertial.find("mass"), inertial.find("inertia")
    inertia = np.zeros((3, 3))
    if moments is not None:
        for i, j, key in ((0, 0, "ixx"), (0, 1, "ixy"), (0, 2, "ixz"),
                          (1, 1, "iyy"), (1, 2, "iyz"), (2, 2, "izz")):  # fmt: skip
            inertia[i, j] = inertia[j, i] = float(moments.get(key, "0"))
    R = T_link_com[:3, :3]
    kilograms = 0.0 if mass is None else float(mass.get("value", "0"))
    return Link(name, kilograms, T_link_com[:3, 3], R @ inertia @ R.T)


def _origin(origin: ET.Element | None) -> Float[np.ndarray, "4 4"]:
    if origin is None:
        return np.eye(4)
    # Fixed-axis roll, pitch, yaw.
    R = Rotation.from_euler("xyz", _numbers(origin.get("rpy", "0 0 0"))).as_matrix()
    return make_transform(R, _numbers(origin.get("xyz", "0 0 0")))


def _numbers(text: str) -> Float[np.ndarray, "K"]:
    return np.array([float(word) for word in text.split()])
