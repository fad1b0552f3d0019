"""Small inputs for the network's tests."""

import torch

from robust6dof.network.config import NetworkConfig
from robust6dof.network.inputs import ViewBatch


def random_rotations(count, generator):
    Q, R = torch.linalg.qr(torch.randn(count, 3, 3, generator=generator))
    Q = Q * R.diagonal(dim1=-2, dim2=-1).sign()[:, None]
    return Q * torch.det(Q)[:, None, None]


def random_view(config: NetworkConfig, batch: int = 2, seed: int = 0) -> ViewBatch:
    generator = torch.Generator().manual_seed(seed)
    T_cam_pred = torch.eye(4).repeat(batch, 1, 1)
    T_cam_pred[:, :3, :3] = random_rotations(batch, generator)
    T_cam_pred[:, :3, 3] = torch.randn(batch, 3, generator=generator) * 0.1 + torch.tensor(
        [0.0, 0.0, 0.8]
    )
    points = torch.rand(batch, config.points, 3, generator=generator) - 0.5
    size = config.crop_px
    return ViewBatch(
        points=points,
        rgb=torch.rand(batch, 3, size, size, generator=generator),
        pixels=torch.rand(batch, config.points, 2, generator=generator) * (size - 1),
        T_cam_pred=T_cam_pred,
        scale=torch.rand(batch, generator=generator) * 0.2 + 0.1,
    )


def random_prior(config: NetworkConfig, batch: int = 2, seed: int = 5) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    return torch.rand(batch, config.prior_points, 3, generator=generator) - 0.5
