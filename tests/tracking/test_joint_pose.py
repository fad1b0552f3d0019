"""Both solvers on a view that is another one, rigidly moved: the change must come out exactly."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from robust6dof.geometry.transforms import make_transform, rotation_error, transform_points
from robust6dof.network.config import preset
from robust6dof.network.inputs import ViewFeatures
from robust6dof.network.robust6dof_net import Robust6DofNet
from robust6dof.tracking.encoder import ViewEncoder
from robust6dof.tracking.joint_pose import JointPose, JointPoseConfig, solve_joint_pose
from robust6dof.tracking.keyframes import Keyframe
from tracking.test_tracker import EXTENTS, START, K, bump

STEP = make_transform(
    Rotation.from_rotvec([0.05, -0.1, 0.08]).as_matrix(), np.array([0.02, 0.01, -0.03])
)


@pytest.fixture(scope="module")
def encoder() -> ViewEncoder:
    torch.manual_seed(0)
    prior = np.random.default_rng(0).uniform(-0.4, 0.4, (200, 3)).astype(np.float32)
    return ViewEncoder(Robust6DofNet(preset("tiny")), prior, "mug")


def spread(features: ViewFeatures) -> ViewFeatures:
    """Keypoints of an untrained network huddle and look alike: give them places and looks."""
    rng = np.random.default_rng(0)
    count = features.keypoints_cam.shape[1]
    places = transform_points(START, rng.uniform(-0.05, 0.05, (count, 3)))
    width = features.keypoint_features.shape[-1]
    looks = torch.from_numpy(rng.normal(size=(1, count, width))).float()
    return replace(
        features,
        keypoints_cam=torch.from_numpy(places[None]).float(),
        keypoint_features=torch.nn.functional.normalize(looks, dim=-1),
    )


def solved(encoder: ViewEncoder, config: JointPoseConfig) -> JointPose:
    last = spread(encoder.first(bump(), START, EXTENTS))
    moved = transform_points(STEP, last.keypoints_cam[0].double().numpy())
    current = replace(last, keypoints_cam=torch.from_numpy(moved[None]).float())
    scale = float(np.linalg.norm(EXTENTS))
    rng = np.random.default_rng(1)
    with torch.inference_mode():
        past = [Keyframe(last, START, 0.9)]
        return solve_joint_pose(encoder.net, current, past, START, scale, False, K, config, rng)


@pytest.mark.parametrize("solver", ["joint", "pnp"])
def test_a_rigid_change_is_recovered(encoder: ViewEncoder, solver: str) -> None:
    config = JointPoseConfig(solver=solver, anchor_weight=0.0)  # pyright: ignore[reportArgumentType]
    estimate = solved(encoder, config)
    expected = STEP @ START
    assert rotation_error(estimate.T_cam_obj[:3, :3], expected[:3, :3]) < 1e-3
    np.testing.assert_allclose(estimate.T_cam_obj[:3, 3], expected[:3, 3], atol=2e-4)
    assert estimate.support > 0.9
