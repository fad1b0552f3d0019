"""The MuJoCo model, generated from the same data as the kinematics."""

# MuJoCo's names come out of a compiled module, which pyright cannot look into.
# pyright: reportAttributeAccessIssue=false

from __future__ import annotations

import mujoco
import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from robust6dof.robot.aerial_manipulator import AerialManipulator
from robust6dof.robot.arm import Joint, Link
from robust6dof.simulation.autopilot import MassModel
from robust6dof.simulation.vehicle import QuadrotorParameters
from robust6dof.synthetic.room import Surface

_VEHICLE, _FURNITURE = 1, 2
"""Collision groups: the vehicle touches furniture, never itself."""

_JOINT_STIFFNESS = 40.0
"""Of the servo motors' position loop [N·m/rad]."""

_JOINT_DAMPING = 1.6
"""Of the same [N·m·s/rad]; their ratio, 40 ms, is the lag of a joint rate."""

_ARMATURE = 0.01
"""Reflected inertia of a geared motor [kg·m²]; without it light links make MuJoCo diverge."""

_LEAST_MASS, _LEAST_INERTIA = 1e-4, 1e-7
"""Of a link that is described without a mass [kg, kg·m²]."""


def build_model(
    manipulator: AerialManipulator,
    quadrotor: QuadrotorParameters,
    surfaces: tuple[Surface, ...],
    timestep: float,
) -> mujoco.MjModel:
    """Free-flying quadrotor, arm and surfaces.

    Actuators: four rotor thrusts [N] with the motors' lag, then a rate [rad/s] for every joint (a
    position loop whose set-point integrates the rate, as servo motors do it). Body `base` is the
    vehicle, site `camera` the camera with OpenCV axes.
    """
    spec = mujoco.MjSpec()
    spec.modelname = manipulator.arm.name
    spec.option.timestep = timestep
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.compiler.degree = False
    for surface in surfaces:
        _add_surface(spec.worldbody, surface)
    base = _add_vehicle(spec, quadrotor)
    _add_arm(spec, base, manipulator)
    return spec.compile()


def mass_model(model: mujoco.MjModel, joints: Float[np.ndarray, "N"]) -> MassModel:
    """Mass and inertia of the whole vehicle with the arm at `joints`."""
    data = mujoco.MjData(model)
    data.qpos[3] = 1.0
    data.qpos[7:] = joints
    mujoco.mj_forward(model, data)
    M = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, M)
    return MassModel(mass=float(M[0, 0]), inertia=np.diag(M)[3:6].copy())


def _add_surface(world: mujoco.MjsBody, surface: Surface) -> None:
    center = [*surface.center, surface.top - surface.thickness / 2.0]
    world.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[surface.size[0] / 2.0, surface.size[1] / 2.0, surface.thickness / 2.0],
        pos=center,
        quat=_quat_wxyz(Rotation.from_euler("z", surface.yaw).as_matrix()),
        contype=_FURNITURE,
        conaffinity=_VEHICLE,
    )


def _add_vehicle(spec: mujoco.MjSpec, quadrotor: QuadrotorParameters) -> mujoco.MjsBody:
    base = spec.worldbody.add_body(
        name="base",
        mass=quadrotor.mass,
        inertia=list(quadrotor.inertia),
        ipos=[0.0, 0.0, 0.0],
        explicitinertial=True,
    )
    base.add_freejoint()
    reach = quadrotor.rotor_distance / np.sqrt(2.0) + quadrotor.rotor_radius
    base.add_geom(
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=[reach, reach, 0.05],
        mass=0.0,
        contype=_VEHICLE,
        conaffinity=_FURNITURE,
    )
    rotors = zip(quadrotor.rotor_positions, quadrotor.rotor_spins, strict=True)
    for number, (position, spin) in enumerate(rotors):
        base.add_site(name=f"rotor_{number}", pos=position)
        _add_rotor(spec, quadrotor, f"rotor_{number}", float(spin))
    return base


def _add_rotor(spec: mujoco.MjSpec, quadrotor: QuadrotorParameters, name: str, spin: float) -> None:
    actuator = spec.add_actuator(name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_SITE)
    actuator.set_to_motor()
    actuator.dyntype = mujoco.mjtDyn.mjDYN_FILTEREXACT
    actuator.dynprm[0] = quadrotor.motor_time_constant
    actuator.gear = [0.0, 0.0, 1.0, 0.0, 0.0, spin * quadrotor.yaw_moment]
    actuator.ctrllimited = True
    actuator.ctrlrange = [0.0, quadrotor.max_thrust]


def _add_arm(spec: mujoco.MjSpec, base: mujoco.MjsBody, manipulator: AerialManipulator) -> None:
    arm = manipulator.arm
    body = _add_link(base, arm.base, manipulator.T_body_base)
    for joint, link in zip(arm.joints, arm.links, strict=True):
        parent = body
        body = _add_link(parent, link, joint.T_parent_joint)
        start, end = np.zeros(3), joint.T_parent_joint[:3, 3]
        _add_bar(parent, start, end)
        _add_joint(spec, body, joint)
    _add_bar(body, np.zeros(3), arm.T_tip_cam[:3, 3])
    body.add_site(name="camera", pos=arm.T_tip_cam[:3, 3], quat=_quat_wxyz(arm.T_tip_cam[:3, :3]))


def _add_link(
    parent: mujoco.MjsBody, link: Link, T_parent_link: Float[np.ndarray, "4 4"]
) -> mujoco.MjsBody:
    # MuJoCo wants every moving body to weigh something; descriptions often leave some links out.
    m = link.inertia + _LEAST_INERTIA * np.eye(3) * (link.mass == 0.0)
    return parent.add_body(
        name=f"arm/{link.name}",  # apart from the vehicle's own names
        pos=T_parent_link[:3, 3],
        quat=_quat_wxyz(T_parent_link[:3, :3]),
        mass=max(link.mass, _LEAST_MASS),
        ipos=link.center_of_mass,
        fullinertia=[m[0, 0], m[1, 1], m[2, 2], m[0, 1], m[0, 2], m[1, 2]],
        explicitinertial=True,
    )


def _add_bar(
    body: mujoco.MjsBody, start: Float[np.ndarray, "3"], end: Float[np.ndarray, "3"]
) -> None:
    """A weightless capsule, so that the arm can touch the table."""
    if np.linalg.norm(end - start) < 1e-3:
        return
    body.add_geom(
        type=mujoco.mjtGeom.mjGEOM_CAPSULE,
        fromto=[*start, *end],
        size=[0.012, 0.0, 0.0],
        mass=0.0,
        contype=_VEHICLE,
        conaffinity=_FURNITURE,
    )


def _add_joint(spec: mujoco.MjSpec, body: mujoco.MjsBody, joint: Joint) -> None:
    limits = [joint.lower, joint.upper]
    body.add_joint(
        name=joint.name,
        type=mujoco.mjtJoint.mjJNT_HINGE,
        axis=joint.axis,
        limited=True,
        range=limits,
        armature=_ARMATURE,
        damping=[0.1, 0.0, 0.0],
    )
    actuator = spec.add_actuator(
        name=joint.name, target=joint.name, trntype=mujoco.mjtTrn.mjTRN_JOINT
    )
    actuator.set_to_intvelocity(kp=_JOINT_STIFFNESS, kv=_JOINT_DAMPING)
    actuator.ctrllimited, actuator.ctrlrange = True, [-joint.max_rate, joint.max_rate]
    actuator.actlimited, actuator.actrange = True, limits
    if np.isfinite(joint.max_torque):
        actuator.forcelimited = True
        actuator.forcerange = [-joint.max_torque, joint.max_torque]


def _quat_wxyz(R: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "4"]:
    return Rotation.from_matrix(R).as_quat(scalar_first=True)
