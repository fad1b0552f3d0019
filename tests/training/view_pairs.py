"""Two views of a cloud and what is true of them, for the tests of the losses."""

import math
from dataclasses import replace

import torch

from network.scenes import random_prior, random_rotations, random_view
from robust6dof.network.config import preset
from robust6dof.network.inputs import ViewBatch
from robust6dof.network.matching import KeypointMatches, dual_softmax, score_matrix
from robust6dof.network.robust6dof_net import PairOutput, Robust6DofNet
from robust6dof.training.targets import PairTruth

CONFIG = preset("tiny")


def about_y(angle):
    c, s = math.cos(angle), math.sin(angle)
    return torch.tensor([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])


def small_rotation(degrees, generator):
    axis = torch.randn(3, generator=generator)
    axis = axis / axis.norm() * math.radians(degrees)
    x, y, z = axis.tolist()
    return torch.linalg.matrix_exp(torch.tensor([[0, -z, y], [z, 0, -x], [-y, x, 0]]))


def make_pair(batch=2, seed=0, symmetric=False, points=CONFIG.points, degrees=8.0):
    """Two views of a cloud: the truth, predictions off by `degrees` and some millimetres."""
    g = torch.Generator().manual_seed(seed)
    scale = torch.rand(batch, generator=g) * 0.1 + 0.15
    cloud = torch.rand(batch, points, 3, generator=g) - 0.5
    T_prev = torch.eye(4).repeat(batch, 1, 1)
    T_prev[:, :3, :3] = random_rotations(batch, g)
    T_prev[:, :3, 3] = torch.tensor([0.0, 0.0, 0.8])
    T_cur = T_prev.clone()
    views = []
    for b in range(batch):
        T_cur[b, :3, :3] = small_rotation(degrees, g) @ T_prev[b, :3, :3]
        T_cur[b, :3, 3] += 0.02 * torch.randn(3, generator=g)
    for T in (T_prev, T_cur):
        T_pred = T.clone()
        for b in range(batch):
            T_pred[b, :3, :3] = small_rotation(degrees, g) @ T[b, :3, :3]
            T_pred[b, :3, 3] += 0.005 * torch.randn(3, generator=g)
        cam = scale[:, None, None] * cloud @ T[:, :3, :3].mT + T[:, None, :3, 3]
        own = (cam - T_pred[:, None, :3, 3]) @ T_pred[:, :3, :3] / scale[:, None, None]
        view = random_view(CONFIG, batch, seed=seed)
        views.append(ViewBatch(own, view.rgb, view.pixels[:, :points], T_pred, scale))
    on_object = torch.ones(batch, points, dtype=torch.bool)
    truth = PairTruth(T_prev, T_cur, scale, torch.full((batch,), symmetric), on_object, on_object)
    return views, truth, cloud


def perfect_output(views, truth, cloud) -> PairOutput:
    """What a perfect network would say: keypoints are the first points, coordinates the truth."""
    torch.manual_seed(0)
    config = replace(CONFIG, points=cloud.shape[1])
    output = Robust6DofNet(config)(*views, random_prior(config, len(cloud)))
    M = torch.eye(cloud.shape[1])[: CONFIG.keypoints].repeat(len(cloud), 1, 1)
    features = torch.nn.functional.normalize(torch.randn(len(cloud), CONFIG.keypoints, 50), dim=-1)
    said = []
    for view, old in zip(views, (output.previous, output.current), strict=True):
        cam = view.scale[:, None, None] * view.points @ view.T_cam_pred[:, :3, :3].mT
        cam = cam + view.T_cam_pred[:, None, :3, 3]
        said.append(
            replace(
                old,
                canonical=cloud,
                correspondence=cloud,
                assignment=M,
                keypoints=M @ view.points,
                keypoints_cam=M @ cam,
                keypoint_features=features,
                keypoint_canonical=M @ cloud,
            )
        )
    weight = torch.ones(len(cloud), CONFIG.keypoints)
    matches = KeypointMatches(dual_softmax(score_matrix(features, features, 0.01)), weight)
    return PairOutput(said[0], said[1], matches, output.prior)
