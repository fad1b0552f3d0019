"""The default arm, the readers and what the arm can reach."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from robust6dof.errors import DataError, InputError
from robust6dof.geometry.transforms import make_transform, rotation_about_y, rotation_error
from robust6dof.robot.aerial_manipulator import (
    DEFAULT_ARM,
    AerialManipulator,
    default_aerial_manipulator,
    open_manipulator_x,
    read_aerial_manipulator,
)
from robust6dof.robot.arm import Link, merge_links
from robust6dof.robot.mjcf import read_mjcf_arm
from robust6dof.robot.reachability import hover_with_camera_at, reach_goal, reach_view
from robust6dof.robot.urdf import read_urdf_arm
from shared_data import shared_data

ROBOT = default_aerial_manipulator()
LOOK_DOWN = np.array([[1.0, 0, 0], [0, 0, 1.0], [0, -1.0, 0]])
"""R_cam_obj of an upright object seen from straight above."""

URDF = (Path(__file__).parent / "own_arm.urdf").read_text()


def _write(folder: Path, text: str) -> Path:
    path = folder / "arm.xml"
    path.write_text(text)
    return path


def _open_manipulator() -> AerialManipulator:
    return open_manipulator_x(
        shared_data("aerial", "open_manipulator_x_mjcf", "open_manipulator_x.xml")
    )


def test_default_arm_rests_looking_straight_down():
    T_body_cam = ROBOT.T_body_cam(ROBOT.arm.rest)
    np.testing.assert_allclose(T_body_cam[:3, 2], [0, 0, -1], atol=1e-9)  # optical axis
    np.testing.assert_allclose(T_body_cam[:3, 1], [-1, 0, 0], atol=1e-9)  # image down = backward
    margin = np.minimum(ROBOT.arm.upper - ROBOT.arm.rest, ROBOT.arm.rest - ROBOT.arm.lower)
    assert margin.min() > 0.4
    assert ROBOT.arm.mass == pytest.approx(0.55)


def test_default_arm_turns_the_camera_every_way_in_its_whole_workspace():
    rng = np.random.default_rng(0)
    for joints in rng.uniform(ROBOT.arm.lower, ROBOT.arm.upper, (500, 4)):
        assert ROBOT.rotation_rank(joints) == 3
        assert ROBOT.manipulability(joints) > 0.45
        assert ROBOT.T_body_cam(joints)[2, 3] < -0.07  # below the vehicle's belly


def test_manipulability_is_the_product_of_singular_values():
    joints = np.array([0.4, 0.1, -0.7, 0.9])
    singular = np.linalg.svd(ROBOT.camera_arm_jacobian(joints)[3:], compute_uv=False)
    assert ROBOT.manipulability(joints) == pytest.approx(np.prod(singular))


def test_open_manipulator_has_rotation_rank_two():
    robot = _open_manipulator()
    assert [joint.name for joint in robot.arm.joints] == ["Joint1", "Joint2", "Joint3", "Joint4"]
    assert robot.arm.lower[1] == -1.5
    rng = np.random.default_rng(1)
    for joints in rng.uniform(robot.arm.lower, robot.arm.upper, (50, 4)):
        assert robot.rotation_rank(joints) == 2
        assert robot.manipulability(joints) < 1e-6
    # Vehicle yaw only duplicates the first joint.
    J = robot.camera_jacobian(robot.arm.rest)[3:, 5:]
    assert np.linalg.matrix_rank(J, tol=1e-9) == 2


def test_open_manipulator_reaches_goals_above_upright_objects_and_says_which_it_does_not():
    robot = _open_manipulator()
    for yaw in (0.0, 1.0, -2.5):
        R = LOOK_DOWN @ Rotation.from_rotvec([0, yaw, 0]).as_matrix()
        reach = reach_goal(robot, make_transform(R, np.array([0, 0, 0.5])))
        assert reach.reachable
        assert reach.angle_off < 1e-4
    sideways = Rotation.from_rotvec([0, np.radians(20), 0]).as_matrix() @ LOOK_DOWN
    reach = reach_goal(robot, make_transform(sideways, np.array([0, 0, 0.5])))
    assert not reach.reachable
    assert reach.angle_off == pytest.approx(np.radians(20), rel=1e-3)
    assert reach_goal(ROBOT, make_transform(sideways, np.array([0, 0, 0.5]))).reachable


@given(
    forward=st.floats(0, np.radians(50)),
    sideways=st.floats(-np.radians(50), np.radians(50)),
    yaw=st.floats(-np.pi, np.pi),
)
@settings(max_examples=10)
def test_open_manipulator_reaches_what_lies_in_its_arms_plane_and_no_other_view(
    forward: float, sideways: float, yaw: float
):
    """Pitching forward keeps the object's up in the arm's plane; rolling takes it out, by as much
    as is then left."""
    robot = _open_manipulator()
    pitch = Rotation.from_rotvec([-forward, 0, 0])
    roll = Rotation.from_rotvec([0, sideways, 0])
    R_cam_obj = (roll * pitch).as_matrix() @ LOOK_DOWN @ rotation_about_y(yaw)
    reach = reach_goal(robot, make_transform(R_cam_obj, np.array([0, 0, 0.5])))
    out_of_plane = abs(np.arcsin(np.clip(R_cam_obj[0, 1], -1, 1)))  # of up, along the image's x
    assert reach.angle_off == pytest.approx(out_of_plane, abs=2e-3)
    assert reach.reachable == (reach.angle_off < 0.01)


def test_the_object_that_lies_down_needs_another_view():
    lying = make_transform(LOOK_DOWN, np.array([0, 0, 0.5]))
    reach = reach_goal(ROBOT, lying, up_obj=np.array([0.0, -1.0, 0.0]))
    assert not reach.reachable  # looking straight up is beyond the joints
    assert reach.angle_off > 0.5


@given(
    tilt=st.floats(0, np.radians(60)),
    direction=st.floats(-np.pi / 2, np.pi / 2),
    yaw=st.floats(-np.pi, np.pi),
)
def test_hovering_level_with_the_camera_at_a_wanted_view(tilt, direction, yaw):
    """Forward and sideways views up to 60° off straight down, any heading."""
    up = np.array(
        [np.sin(tilt) * np.sin(direction), -np.sin(tilt) * np.cos(direction), -np.cos(tilt)]
    )
    turn, _ = Rotation.align_vectors([[0.0, 0.0, 1.0]], [up])
    look = (Rotation.from_rotvec([0, 0, yaw]) * turn).as_matrix()
    T_world_cam = make_transform(look, np.array([1.0, -2.0, 1.5]))
    T_world_body, reach = hover_with_camera_at(ROBOT, T_world_cam)
    T_world_cam_again = T_world_body @ ROBOT.T_body_cam(reach.joints)
    np.testing.assert_allclose(T_world_cam_again, T_world_cam, atol=1e-12)
    assert ROBOT.within_limits(reach.joints, slack=1e-9)
    assert reach.reachable
    assert np.arccos(np.clip(T_world_body[2, 2], -1, 1)) < 0.011


def test_urdf_and_mjcf_give_the_same_arm(tmp_path: Path):
    arm = read_urdf_arm(_write(tmp_path, URDF), rest=np.zeros(4))
    rng = np.random.default_rng(2)
    for joints in rng.uniform(arm.lower, arm.upper, (10, 4)):
        np.testing.assert_allclose(arm.T_base_cam(joints), ROBOT.arm.T_base_cam(joints), atol=1e-6)
    np.testing.assert_array_equal(arm.lower, ROBOT.arm.lower)
    np.testing.assert_array_equal(arm.max_rates, ROBOT.arm.max_rates)
    assert arm.joints[0].max_torque == ROBOT.arm.joints[0].max_torque == 4.1
    # The camera is fixed to the wrist, which has no mass of its own here.
    assert arm.links[-1].mass == pytest.approx(0.072)
    np.testing.assert_allclose(arm.links[-1].center_of_mass, [0.055, 0, -0.025])
    np.testing.assert_allclose(np.diag(arm.links[-1].inertia), [1e-5, 2e-5, 3e-5])


def test_ones_own_arm_is_read_from_either_format(tmp_path: Path):
    for text in (URDF, DEFAULT_ARM.read_text()):
        robot = read_aerial_manipulator(_write(tmp_path, text))
        joints = np.array([0.3, -0.4, 0.5, 0.1])
        np.testing.assert_allclose(robot.T_body_cam(joints), ROBOT.T_body_cam(joints), atol=1e-6)
    with pytest.raises(DataError, match="URDF or MJCF"):
        read_aerial_manipulator(_write(tmp_path, "no XML"))


@pytest.mark.parametrize("text", [URDF, DEFAULT_ARM.read_text()], ids=["URDF", "MJCF"])
def test_ones_own_arm_is_parsed_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, text: str
) -> None:
    parse, parsed = ET.parse, []
    monkeypatch.setattr(ET, "parse", lambda path: parsed.append(path) or parse(path))
    path = _write(tmp_path, text)
    read_aerial_manipulator(path)
    assert parsed == [path]


def test_masses_match_mujoco_and_pinocchio(tmp_path: Path):
    mujoco = pytest.importorskip("mujoco")
    pin = pytest.importorskip("pinocchio")
    path = _write(tmp_path, DEFAULT_ARM.read_text())
    model = mujoco.MjModel.from_xml_path(str(path))
    assert model.body_subtreemass[0] == pytest.approx(ROBOT.arm.mass)
    inertias = pin.buildModelFromMJCF(str(path)).inertias
    for link, inertia in zip(ROBOT.arm.links, list(inertias)[1:], strict=True):
        assert link.mass == pytest.approx(inertia.mass)
        np.testing.assert_allclose(link.center_of_mass, inertia.lever)
        np.testing.assert_allclose(link.inertia, inertia.inertia, atol=1e-12)


def test_open_manipulator_kinematics_match_mujoco():
    mujoco = pytest.importorskip("mujoco")
    path = shared_data("aerial", "open_manipulator_x_mjcf", "open_manipulator_x.xml")
    arm = open_manipulator_x(path).arm
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    joints = np.array([0.3, -0.7, 0.5, -1.1])
    data.qpos[:4] = joints
    mujoco.mj_kinematics(model, data)
    hand = model.body("link5").id
    T = arm.T_base_links(joints)[-1]
    np.testing.assert_allclose(T[:3, 3], data.xpos[hand], atol=1e-12)
    np.testing.assert_allclose(T[:3, :3], data.xmat[hand].reshape(3, 3), atol=1e-12)
    for link, name in zip(arm.links, ("link2", "link3", "link4", "link5"), strict=True):
        assert link.mass == pytest.approx(model.body(name).mass[0])


def test_mjcf_orientations_match_mujoco(tmp_path: Path):
    mujoco = pytest.importorskip("mujoco")
    path = _write(
        tmp_path,
        """<mujoco model="odd"><worldbody><body name="base">
        <body name="a" pos="0.1 0 0" euler="10 20 30">
          <joint name="j1" axis="0 0 2" range="-90 90"/><geom size="0.1"/>
          <body name="fixed" pos="0 0.1 0" axisangle="1 1 0 40">
            <body name="b" pos="0 0 0.1" xyaxes="1 1 0 0 1 1">
              <joint name="j2" axis="1 0 0" range="-45 45"/><geom size="0.1"/>
              <site name="camera" pos="0 0 0.2"/></body></body></body></body></worldbody>
        </mujoco>""",
    )
    arm = read_mjcf_arm(path)
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    data.qpos[:] = [0.4, -0.3]
    mujoco.mj_kinematics(model, data)
    T = arm.T_base_cam(np.array([0.4, -0.3]))
    np.testing.assert_allclose(T[:3, 3], data.site_xpos[0], atol=1e-9)
    assert rotation_error(T[:3, :3], data.site_xmat[0].reshape(3, 3)) < 1e-9
    np.testing.assert_allclose(arm.upper, np.radians([90, 45]))


def test_merged_links_keep_their_total_inertia():
    """Against the definition: a cloud of point masses split in two bodies."""
    rng = np.random.default_rng(3)
    points, masses = rng.normal(size=(10, 3)), rng.uniform(0.1, 1, 10)

    def link_of(points: np.ndarray, masses: np.ndarray) -> Link:
        com = masses @ points / masses.sum()
        off = points - com
        inertia = sum(
            m * (p @ p * np.eye(3) - np.outer(p, p)) for m, p in zip(masses, off, strict=True)
        )
        return Link("cloud", float(masses.sum()), com, np.asarray(inertia))

    T = make_transform(Rotation.from_rotvec([0.3, -0.5, 0.9]).as_matrix(), np.array([1.0, 2, 3]))
    in_fixed = (points[6:] - T[:3, 3]) @ T[:3, :3]
    merged = merge_links(link_of(points[:6], masses[:6]), link_of(in_fixed, masses[6:]), T)
    whole = link_of(points, masses)
    np.testing.assert_allclose(merged.center_of_mass, whole.center_of_mass)
    np.testing.assert_allclose(merged.inertia, whole.inertia)


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("<mujoco><worldbody>", "not readable as XML"),
        ("<robot name='x'/>", "root is <robot>"),
        ("<mujoco><worldbody><body/></worldbody></mujoco>", "no site 'camera'"),
        (
            "<mujoco><worldbody><body><body><joint name='j'/><site name='camera'/></body></body>"
            "</worldbody></mujoco>",
            "no hinge with a range",
        ),
    ],
)
def test_mjcf_problems_are_named(tmp_path: Path, text: str, problem: str):
    with pytest.raises(DataError, match=problem):
        read_mjcf_arm(_write(tmp_path, text))


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ('type="revolute"', 'type="continuous"', "continuous"),
        ("camera_optical_frame", "lens", "no link 'camera_optical_frame'"),
        ("</robot>", "", "not readable as XML"),
    ],
)
def test_urdf_problems_are_named(tmp_path: Path, old: str, new: str, problem: str):
    with pytest.raises(DataError, match=problem):
        read_urdf_arm(_write(tmp_path, URDF.replace(old, new)))


def test_wrong_number_of_angles_is_named():
    with pytest.raises(InputError, match="4 joints"):
        ROBOT.T_body_cam(np.zeros(6))


def test_reach_is_deterministic():
    up = np.array([0.2, -0.5, -0.8])
    up /= np.linalg.norm(up)
    a, b = reach_view(ROBOT, up), reach_view(ROBOT, up)
    np.testing.assert_array_equal(a.joints, b.joints)
