"""Read an arm from MJCF, MuJoCo's model format.

The subset: nested `body` elements with `pos` and `quat`, `axisangle`, `euler` (intrinsic xyz) or
`xyaxes`; hinge `joint`s with `axis`, `range` and `actuatorfrcrange`, at most one a body and at
its origin; `inertial` with `diaginertia` or `fullinertia`; nested `default` classes and
`childclass`; `compiler angle`; a `keyframe` named `home`; `custom/numeric joint_rate_limits`
(rad/s, MJCF itself has no such limit). The chain runs from the first body of the world to the
camera's body; branches (a gripper) and their mass are left out. The camera's site has OpenCV axes.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from robust6dof.errors import DataError
from robust6dof.geometry.transforms import make_transform
from robust6dof.robot.arm import Arm, Joint, Link, Segment, build_arm
from robust6dof.robot.xml_root import read_xml_root


def read_mjcf_arm(
    path: str | Path,
    *,
    root: ET.Element | None = None,
    camera: str = "camera",
    tip: str | None = None,
    T_tip_cam: Float[np.ndarray, "4 4"] | None = None,
    rest: Float[np.ndarray, "N"] | None = None,
    max_rate: float = 2.5,
) -> Arm:
    """Read the chain from the first body of the world to the camera.

    Args:
        path: the MJCF file.
        root: the file's root, where it is parsed already.
        camera: name of the site that stands for the camera.
        tip, T_tip_cam: instead of a site, the body that carries the camera and where on it.
        rest: the posture to rest in [rad]; else keyframe `home`, else the middle of the ranges.
        max_rate: limit of the joint rates [rad/s] where the file states none.

    Raises:
        DataError: unreadable XML, no such site or body, an unlimited or non-hinge joint.
    """
    path = Path(path)
    root = read_xml_root(path, "an MJCF file") if root is None else root
    model = _Model.of(root, path)
    chain = model.chain_to(camera, tip)
    if T_tip_cam is None:
        T_tip_cam = model.site_frame(chain[-1], camera)
    segments = [model.segment(body) for body in chain[1:]]
    names = [segment.joint.name for segment in segments if segment.joint is not None]
    rates = model.numbers_of("joint_rate_limits") or [max_rate] * len(names)
    if len(rates) != len(names):
        raise model.error(f"joint_rate_limits has {len(rates)} numbers for {len(names)} joints")
    if rest is None:
        rest = model.home(names)
    return build_arm(
        model.name, model.link(chain[0]), segments, T_tip_cam, np.array(rates, dtype=float), rest
    )


def _numbers(text: str) -> np.ndarray:
    return np.array([float(word) for word in text.split()])


@dataclass(frozen=True)
class _Model:
    """The parsed file: attributes with their defaults resolved, angles in radians."""

    path: Path
    root: ET.Element
    parents: dict[ET.Element, ET.Element]

    @classmethod
    def of(cls, root: ET.Element, path: Path) -> _Model:
        if root.tag != "mujoco":
            raise DataError(path, f"the root is <{root.tag}>", "Give an MJCF file (<mujoco>)")
        return cls(path, root, {child: parent for parent in root.iter() for child in parent})

    @property
    def name(self) -> str:
        return self.root.get("model", self.path.stem)

    def error(self, problem: str) -> DataError:
        return DataError(
            self.path, problem, "See robust6dof.robot.mjcf for the subset that is read"
        )

    def chain_to(self, camera: str, tip: str | None) -> list[ET.Element]:
        """Bodies from the world's first one to the camera's."""
        world = self.root.find("worldbody")
        if world is None:
            raise self.error("no <worldbody>")
        for body in world.iter("body"):
            sites = [site.get("name") for site in body.findall("site")]
            if camera in sites if tip is None else body.get("name") == tip:
                break
        else:
            wanted = f"body '{tip}'" if tip else f"site '{camera}'"
            raise self.error(f"no {wanted}")
        chain = [body]
        while (above := self.parents[chain[0]]) is not world:
            chain.insert(0, above)
        return chain

    def attributes(self, element: ET.Element) -> dict[str, str]:
        """The element's attributes over those of its default classes."""
        wanted = element.get("class")
        above: ET.Element | None = element
        while wanted is None and above is not None:
            wanted = above.get("childclass")
            above = self.parents.get(above)
        top = self.root.find("default")
        classes: list[ET.Element] = [] if top is None else [top]
        if wanted is not None and top is not None:
            classes = self._class_path(top, wanted)
        merged: dict[str, str] = {}
        for default in classes:
            for same in default.findall(element.tag):
                merged |= same.attrib
        return merged | element.attrib

    def _class_path(self, top: ET.Element, wanted: str) -> list[ET.Element]:
        for default in top.iter("default"):
            if default.get("class", "main") == wanted:
                path = [default]
                while path[0] is not top:
                    path.insert(0, self.parents[path[0]])
                return path
        raise self.error(f"no default class '{wanted}'")

    @property
    def angle_unit(self) -> float:
        """MJCF counts in degrees unless the compiler says radian."""
        compiler = self.root.find("compiler")
        degrees = compiler is None or compiler.get("angle", "degree") == "degree"
        return float(np.pi / 180) if degrees else 1.0

    def frame(self, element: ET.Element) -> np.ndarray:
        """`pos` and orientation of a body, site or inertial, in its parent."""
        attributes = self.attributes(element)
        position = _numbers(attributes.get("pos", "0 0 0"))
        return make_transform(self._rotation(attributes), position)

    def _rotation(self, attributes: dict[str, str]) -> np.ndarray:
        if "quat" in attributes:
            quat_wxyz = _numbers(attributes["quat"])
            return Rotation.from_quat(quat_wxyz, scalar_first=True).as_matrix()
        if "axisangle" in attributes:
            *axis, angle = _numbers(attributes["axisangle"])
            unit = np.array(axis) / np.linalg.norm(axis)
            return Rotation.from_rotvec(self.angle_unit * angle * unit).as_matrix()
        if "euler" in attributes:
            angles = self.angle_unit * _numbers(attributes["euler"])
            return Rotation.from_euler("XYZ", angles).as_matrix()
        if "xyaxes" in attributes:
            x, y = np.split(_numbers(attributes["xyaxes"]), 2)
            x = x / np.linalg.norm(x)
            y = y - x * (x @ y)
            y = y / np.linalg.norm(y)
            return np.stack([x, y, np.cross(x, y)], axis=1)
        return np.eye(3)

    def site_frame(self, body: ET.Element, name: str) -> np.ndarray:
        for site in body.findall("site"):
            if site.get("name") == name:
                return self.frame(site)
        raise self.error(f"no site '{name}' on body '{body.get('name')}'")

    def segment(self, body: ET.Element) -> Segment:
        hinges = body.findall("joint")
        if len(hinges) > 1:
            raise self.error(f"body '{body.get('name')}' has {len(hinges)} joints")
        T_parent_body = self.frame(body)
        joint = self.joint(hinges[0], T_parent_body) if hinges else None
        return Segment(T_parent_body, self.link(body), joint)

    def joint(self, hinge: ET.Element, T_parent_joint: np.ndarray) -> Joint:
        attributes = self.attributes(hinge)
        name = attributes.get("name", "")
        if attributes.get("type", "hinge") != "hinge" or "range" not in attributes:
            raise self.error(f"joint '{name}' is no hinge with a range")
        if np.any(_numbers(attributes.get("pos", "0 0 0"))):
            raise self.error(f"joint '{name}' is not at its body's origin")
        axis = _numbers(attributes.get("axis", "0 0 1"))
        lower, upper = self.angle_unit * _numbers(attributes["range"])
        torque = _numbers(attributes.get("actuatorfrcrange", "-inf inf"))[1]
        unit = axis / np.linalg.norm(axis)
        return Joint(name, T_parent_joint, unit, float(lower), float(upper), np.inf, float(torque))

    def link(self, body: ET.Element) -> Link:
        name = body.get("name", "")
        inertial = body.find("inertial")
        if inertial is None:
            return Link(name, 0.0, np.zeros(3), np.zeros((3, 3)))
        T_link_com = self.frame(inertial)
        if "fullinertia" in inertial.attrib:
            xx, yy, zz, xy, xz, yz = _numbers(inertial.attrib["fullinertia"])
            inertia = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
        else:
            inertia = np.diag(_numbers(inertial.attrib["diaginertia"]))
        R = T_link_com[:3, :3]
        return Link(name, float(inertial.attrib["mass"]), T_link_com[:3, 3], R @ inertia @ R.T)

    def numbers_of(self, name: str) -> list[float] | None:
        for numeric in self.root.findall("custom/numeric"):
            if numeric.get("name") == name:
                return [float(word) for word in numeric.get("data", "").split()]
        return None

    def home(self, names: list[str]) -> np.ndarray | None:
        """Angles of the chain's joints in keyframe `home` (joints counted in file order)."""
        order = [self.attributes(j).get("name") for j in self.root.findall("worldbody//joint")]
        for key in self.root.findall("keyframe/key"):
            if key.get("name") == "home" and "qpos" in key.attrib:
                values = key.attrib["qpos"].split()
                if len(values) == len(order):
                    return np.array([float(values[order.index(name)]) for name in names])
        return None
