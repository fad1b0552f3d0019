"""How the aerial manipulator looks: one mesh for the vehicle and one for each link of its arm."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from robust6dof.rendering.scene import MeshInstance
from robust6dof.robot.aerial_manipulator import AerialManipulator
from robust6dof.shapes.mesh import TexturedMesh
from robust6dof.simulation.vehicle import QuadrotorParameters
from robust6dof.synthetic.primitives import box, cylinder, moved, placed, plain, tube

_CARBON, _SHELL, _ACCENT = plain(42, 44, 48), plain(225, 228, 232), plain(226, 104, 34)
_SILVER, _BLADE = plain(176, 182, 190), plain(70, 74, 82)
_FRONT_BLADE = plain(226, 104, 34)


@dataclass(frozen=True, eq=False)
class VehicleLook:
    """Meshes in the frames of vehicle and links."""

    manipulator: AerialManipulator
    vehicle: tuple[TexturedMesh, ...]
    """In the body frame."""
    links: tuple[tuple[TexturedMesh, ...], ...]
    """In each moving link's frame."""

    @staticmethod
    def build(manipulator: AerialManipulator, quadrotor: QuadrotorParameters) -> VehicleLook:
        """The meshes, from the data that the physics uses."""
        arm = manipulator.arm
        starts = [joint.T_parent_joint[:3, 3] for joint in arm.joints[1:]]
        links = [_bar(end, 0.011, _SILVER) for end in starts]
        links.append((*_bar(arm.T_tip_cam[:3, 3], 0.009, _SILVER), *_camera(arm.T_tip_cam)))
        turret = _bar(arm.joints[0].T_parent_joint[:3, 3], 0.028, _CARBON)
        base = tuple(moved(mesh, manipulator.T_body_base) for mesh in turret)
        return VehicleLook(manipulator, (*_airframe(quadrotor), *base), tuple(links))

    def instances(
        self,
        T_world_body: Float[np.ndarray, "4 4"],
        joints: Float[np.ndarray, "N"],
        instance_id: int,
    ) -> list[MeshInstance]:
        """The vehicle placed in the world."""
        T_world_links = T_world_body @ self.manipulator.T_body_links(joints)
        placed_meshes = [(mesh, T_world_body) for mesh in self.vehicle]
        for T_world_link, link in zip(T_world_links, self.links, strict=True):
            placed_meshes += [(mesh, T_world_link) for mesh in link]
        return [MeshInstance(mesh, T, instance_id) for mesh, T in placed_meshes]


def _airframe(quadrotor: QuadrotorParameters) -> tuple[TexturedMesh, ...]:
    hub = np.array([0.0, 0.0, 0.0])
    parts = [
        box((0.17, 0.13, 0.05), _SHELL),
        placed(box((0.12, 0.08, 0.03), _CARBON), 0.0, 0.0, 0.04),
        placed(box((0.02, 0.09, 0.03), _ACCENT), 0.086, 0.0, 0.0),
        placed(box((0.08, 0.08, 0.05), _CARBON), 0.0, 0.0, -0.04),
    ]
    for position in quadrotor.rotor_positions:
        motor = position - np.array([0.0, 0.0, 0.02])
        blade = _FRONT_BLADE if position[0] > 0 else _BLADE
        parts += [
            tube(hub, motor - np.array([0.0, 0.0, 0.015]), 0.010, _CARBON),
            placed(cylinder(0.018, 0.035, _SILVER), *motor),
            placed(cylinder(quadrotor.rotor_radius, 0.004, blade, sides=32), *position),
        ]
    return tuple(parts)


def _bar(end: Float[np.ndarray, "3"], radius: float, color: np.ndarray) -> tuple[TexturedMesh, ...]:
    """A link from its joint to the next, with the joint's motor as a box."""
    motor = box((0.034, 0.030, 0.034), _CARBON)
    if np.linalg.norm(end) < 1e-3:
        return (motor,)
    return motor, tube(np.zeros(3), np.asarray(end), radius, color)


def _camera(T_tip_cam: Float[np.ndarray, "4 4"]) -> list[TexturedMesh]:
    """A D435i-like bar whose lenses lie in the plane of the camera's origin."""
    housing = placed(box((0.090, 0.025, 0.025), _SILVER), 0.0, 0.0, -0.0135)
    lenses = [placed(cylinder(0.006, 0.002, _CARBON), x, 0.0, -0.002) for x in (-0.03, 0.0, 0.03)]
    return [moved(mesh, T_tip_cam) for mesh in (housing, *lenses)]
