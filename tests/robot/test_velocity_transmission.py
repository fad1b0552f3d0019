"""The camera's Jacobian against finite differences, MuJoCo, pinocchio and the paper's blocks."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest

from robust6dof.geometry.transforms import invert_transform, make_transform, skew
from robust6dof.robot.aerial_manipulator import (
    DEFAULT_ARM,
    AerialManipulator,
    default_aerial_manipulator,
    open_manipulator_x,
)
from robust6dof.robot.velocity_transmission import (
    approximate_camera_jacobian,
    generalized_transform,
    printed_camera_jacobian,
)
from shared_data import shared_data

ROBOT = default_aerial_manipulator()


def _random_joints(rng: np.random.Generator, robot: AerialManipulator = ROBOT) -> np.ndarray:
    return rng.uniform(robot.arm.lower, robot.arm.upper)


def _flying_arm(folder: Path) -> Path:
    """The default arm on a free body, as MJCF for the oracles."""
    root = ET.fromstring(DEFAULT_ARM.read_text())
    world = root.find("worldbody")
    base = world.find("body")
    world.remove(base)
    vehicle = ET.SubElement(world, "body", name="vehicle")
    ET.SubElement(vehicle, "freejoint", name="free")
    ET.SubElement(vehicle, "inertial", pos="0 0 0", mass="1", diaginertia="0.01 0.01 0.01")
    base.set("pos", "0 0 -0.06")
    vehicle.append(base)
    root.remove(root.find("keyframe"))
    path = folder / "flying_arm.xml"
    ET.ElementTree(root).write(path)
    return path


def _twist_by_differences(robot: AerialManipulator, joints: np.ndarray, q_dot: np.ndarray):
    """V_C by moving vehicle and joints a little both ways."""
    step = 1e-6

    def T_start_cam(s: float) -> np.ndarray:
        # Body moves by its own twist; first order is all that central differences need.
        T_start_body = make_transform(np.eye(3) + s * skew(q_dot[3:6]), s * q_dot[:3])
        return T_start_body @ robot.T_body_cam(joints + s * q_dot[6:])

    T = T_start_cam(0.0)
    derivative = (T_start_cam(step) - T_start_cam(-step)) / (2 * step)
    R = T[:3, :3]
    omega_hat = R.T @ derivative[:3, :3]
    omega = np.array([omega_hat[2, 1], omega_hat[0, 2], omega_hat[1, 0]])
    return np.concatenate([R.T @ derivative[:3, 3], omega])


def test_camera_jacobian_matches_finite_differences():
    rng = np.random.default_rng(0)
    for _ in range(20):
        joints, q_dot = _random_joints(rng), rng.normal(size=10)
        expected = _twist_by_differences(ROBOT, joints, q_dot)
        np.testing.assert_allclose(ROBOT.camera_jacobian(joints) @ q_dot, expected, atol=1e-8)


def test_open_manipulator_jacobian_matches_finite_differences():
    robot = open_manipulator_x(
        shared_data("aerial", "open_manipulator_x_mjcf", "open_manipulator_x.xml")
    )
    rng = np.random.default_rng(1)
    for _ in range(5):
        joints, q_dot = _random_joints(rng, robot), rng.normal(size=10)
        expected = _twist_by_differences(robot, joints, q_dot)
        np.testing.assert_allclose(robot.camera_jacobian(joints) @ q_dot, expected, atol=1e-8)


def test_camera_jacobian_matches_mujoco(tmp_path: Path):
    mujoco = pytest.importorskip("mujoco")
    model = mujoco.MjModel.from_xml_path(str(_flying_arm(tmp_path)))
    data = mujoco.MjData(model)
    site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE, "camera")
    rng = np.random.default_rng(2)
    for _ in range(10):
        joints = _random_joints(rng)
        quat_wxyz = rng.normal(size=4)
        data.qpos[:] = [*rng.normal(size=3), *quat_wxyz / np.linalg.norm(quat_wxyz), *joints]
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        linear, angular = np.zeros((3, 10)), np.zeros((3, 10))
        mujoco.mj_jacSite(model, data, linear, angular, site)
        R_world_cam = data.site_xmat[site].reshape(3, 3)
        R_world_body = data.xmat[1].reshape(3, 3)
        J = np.vstack([R_world_cam.T @ linear, R_world_cam.T @ angular])
        # MuJoCo's free joint: linear velocity in the world, angular in the body.
        J[:, :3] = J[:, :3] @ R_world_body
        np.testing.assert_allclose(ROBOT.camera_jacobian(joints), J, atol=1e-12)
        np.testing.assert_allclose(
            R_world_body @ ROBOT.T_body_cam(joints)[:3, :3], R_world_cam, atol=1e-12
        )


def test_camera_jacobian_matches_pinocchio(tmp_path: Path):
    pin = pytest.importorskip("pinocchio")
    model = pin.buildModelFromMJCF(str(_flying_arm(tmp_path)))
    data = model.createData()
    frame = model.getFrameId("camera")
    rng = np.random.default_rng(3)
    for _ in range(10):
        joints = _random_joints(rng)
        quat_xyzw = rng.normal(size=4)
        q = np.array([*rng.normal(size=3), *quat_xyzw / np.linalg.norm(quat_xyzw), *joints])
        # Its free flyer has linear and angular velocity in the body, as here.
        J = pin.computeFrameJacobian(model, data, q, frame, pin.ReferenceFrame.LOCAL)
        np.testing.assert_allclose(ROBOT.camera_jacobian(joints), J, atol=1e-12)


def test_generalized_transform_is_the_printed_block_matrix():
    rng = np.random.default_rng(4)
    T_body_cam = ROBOT.T_body_cam(_random_joints(rng))
    U = generalized_transform(T_body_cam)
    R, r = T_body_cam[:3, :3], T_body_cam[:3, 3]
    np.testing.assert_array_equal(U[:3, 3:], 0)
    np.testing.assert_allclose(U[3:, :3], np.cross(r, R.T).T)  # column by column r × R e_i
    # Transposed it carries a body's twist: U(A→C) U(C→B) compose like the transforms.
    T_cam_other = make_transform(R.T, np.array([0.1, -0.2, 0.3]))
    np.testing.assert_allclose(
        generalized_transform(T_body_cam @ T_cam_other),
        U @ generalized_transform(T_cam_other),
        atol=1e-15,
    )
    np.testing.assert_allclose(
        generalized_transform(invert_transform(T_body_cam)) @ U, np.eye(6), atol=1e-15
    )


def test_jacobian_blocks_are_those_of_the_paper():
    joints = np.array([0.3, -0.2, -0.4, 0.5])
    J = ROBOT.camera_jacobian(joints)
    T_body_cam = ROBOT.T_body_cam(joints)
    R, r = T_body_cam[:3, :3], T_body_cam[:3, 3]
    # r̄_C^B with its cross product: [R_c_b, −R_c_b [r]×; 0, R_c_b].
    expected = np.block([[R.T, -R.T @ skew(r)], [np.zeros((3, 3)), R.T]])
    np.testing.assert_allclose(ROBOT.vehicle_jacobian(joints), expected, atol=1e-15)
    np.testing.assert_allclose(
        ROBOT.command_jacobian(joints), expected[:, [0, 1, 2, 5]], atol=1e-15
    )
    np.testing.assert_allclose(ROBOT.tilt_jacobian(joints), expected[:, [3, 4]], atol=1e-15)
    np.testing.assert_allclose(
        np.kron(np.eye(2), R.T) @ ROBOT.arm_jacobian(joints), J[:, 6:], atol=1e-15
    )


def test_arm_jacobian_columns_are_axis_and_lever():
    """J_m in the body frame is the textbook's [z × (p_cam − p_joint); z]."""
    joints = np.array([-0.5, 0.2, -0.6, -0.7])
    T_links, p_cam = ROBOT.T_body_links(joints), ROBOT.T_body_cam(joints)[:3, 3]
    for i, joint in enumerate(ROBOT.arm.joints):
        z = T_links[i, :3, :3] @ joint.axis
        column = np.concatenate([np.cross(z, p_cam - T_links[i, :3, 3]), z])
        np.testing.assert_allclose(ROBOT.arm_jacobian(joints)[:, i], column, atol=1e-12)


def test_eq_5_is_an_approximation_and_its_printed_form_is_wrong():
    """What Eq. 5 leaves out: up to 0.2 m per rad/s of a joint; its lever arm is misplaced."""
    rng = np.random.default_rng(5)
    errors = []
    for _ in range(200):
        joints = _random_joints(rng)
        T_body_cam, T_axes = ROBOT.T_body_cam(joints), ROBOT.T_body_axes(joints)
        off = ROBOT.camera_jacobian(joints) - approximate_camera_jacobian(T_body_cam, T_axes)
        np.testing.assert_allclose(off[:, :6], 0, atol=1e-15)
        np.testing.assert_allclose(off[3:], 0, atol=1e-15)
        errors.append(np.linalg.norm(off[:3, 6:], ord=2))
        printed = printed_camera_jacobian(T_body_cam, T_axes)
        assert np.abs(printed[3:, :3] - ROBOT.camera_jacobian(joints)[3:, :3]).max() > 0.05
    assert 0.1 < np.median(errors) < 0.4
