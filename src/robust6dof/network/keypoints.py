"""Stage 3, first half: prior-guided keypoints, their tri-plane features, the canonical anchor."""

from __future__ import annotations

import torch
import torch.nn.functional as F
from jaxtyping import Float, Int
from torch import Tensor, nn

from robust6dof.network import max_filter_numba, nearest_numba
from robust6dof.network.attention import FeedForward, LowRankAttention
from robust6dof.network.config import NetworkConfig
from robust6dof.network.inputs import PriorFeatures

_PLANES = ((0, 1), (1, 2), (0, 2))
"""Axes of the three planes: XY, YZ, XZ."""

_LOG_ERROR_RANGE = (-6.0, 1.0)


class AssignmentHead(nn.Module):
    """The low-rank Transformer that estimates M from {F_obj, F_temp, F_aug} as query, key, value.

    Row k of M is the softmax over the points of <q_k, h_i>, plus, for prior keypoints, a
    preference −β ‖c_i − p_k‖² for points whose canonical coordinate c_i is near the prior's point
    p_k, plus the log-probability that the point lies on the object.
    """

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        width = config.width
        self.config = config
        average = config.contraction == "average"
        self.attention = LowRankAttention(width, config.heads, config.rank, average=average)
        self.norm = nn.LayerNorm(width)
        self.feed_forward = FeedForward(width, config.ffn_ratio)
        self.out_norm = nn.LayerNorm(width)
        if config.keypoint_source == "prior":
            self.query = nn.Linear(width, width)
            self.log_beta = nn.Parameter(torch.tensor(5.0))
        else:
            self.queries = nn.Parameter(torch.randn(config.keypoints, width))

    def forward(
        self,
        f_obj: Float[Tensor, "B N D"],
        f_temp: Float[Tensor, "B N D"],
        f_aug: Float[Tensor, "B N D"],
        canonical: Float[Tensor, "B N 3"],
        foreground: Float[Tensor, "B N"],
        prior: PriorFeatures,
    ) -> Float[Tensor, "B K N"]:
        """M."""
        hidden = self.norm(f_obj + f_aug + self.attention(f_obj, f_temp, f_aug, context=f_temp))
        hidden = self.out_norm(hidden + self.feed_forward(hidden))
        query, key = self._queries(prior) * hidden.shape[-1] ** -0.5, hidden
        bias = hidden.new_zeros(hidden.shape[:2])
        if self.config.foreground:
            bias = F.logsigmoid(foreground.detach())
        if self.config.keypoint_source == "prior" and self.config.structure_bias:
            # −β ‖c − p‖² = 2β c·p − β ‖c‖² − β ‖p‖², the last the same for a whole row.
            # Detached: the place on the prior is taught by its own loss alone.
            beta, place = self.log_beta.exp(), canonical.detach()
            query = torch.cat([query, 2.0 * beta * prior.anchors], -1)
            key = torch.cat([key, place], -1)
            bias = bias - beta * place.square().sum(-1)
        return torch.baddbmm(bias[:, None], query, key.mT).softmax(-1)

    def _queries(self, prior: PriorFeatures) -> Tensor:
        if self.config.keypoint_source == "prior":
            return self.query(prior.anchor_features)
        return self.queries.expand(len(prior.points), -1, -1)


class UnsupervisedKeypoints(nn.Module):
    """Keypoints as 6-PACK makes them: coordinates regressed from one attention-pooled feature.

    They need not be combinations of points; M is then the soft nearest neighbour, through which
    they get their features and canonical coordinates.
    """

    def __init__(self, config: NetworkConfig, sharpness: float = 400.0) -> None:
        super().__init__()
        width = config.width
        self.sharpness = sharpness
        self.importance = nn.Linear(width, 1)
        self.regress = nn.Sequential(
            nn.Linear(width, 2 * width), nn.GELU(), nn.Linear(2 * width, 3 * config.keypoints)
        )

    def forward(
        self, f_aug: Float[Tensor, "B N D"], points: Float[Tensor, "B N 3"]
    ) -> tuple[Float[Tensor, "B K 3"], Float[Tensor, "B K N"]]:
        """Keypoints and M."""
        attention = self.importance(f_aug).softmax(1).mT
        keypoints = (attention @ points) + self.regress(attention @ f_aug).unflatten(-1, (-1, 3))[
            :, 0
        ]
        assignment = (-self.sharpness * _square_distance(keypoints.detach(), points)).softmax(-1)
        return keypoints, assignment


class TriPlane(nn.Module):
    """Keypoint features: the embeddings on three planes, read at the nearest point in each."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.planes = nn.Linear(3 * config.width, 3 * config.plane_width)

    def forward(
        self,
        keypoints: Float[Tensor, "B K 3"],
        points: Float[Tensor, "B N 3"],
        embeddings: Float[Tensor, "B N E"],
    ) -> Float[Tensor, "B K F"]:
        """F̃_kp of unit length; `embeddings` is {F_obj, F_temp, F_aug} side by side."""
        planes = self.planes(embeddings).chunk(3, -1)
        found = [
            plane.gather(1, nearest[..., None].expand(-1, -1, plane.shape[-1]))
            for plane, nearest in zip(planes, nearest_in_planes(keypoints, points), strict=True)
        ]
        return F.normalize(torch.cat(found, -1), dim=-1)


def nearest_in_planes(
    keypoints: Float[Tensor, "B K 3"], points: Float[Tensor, "B N 3"]
) -> list[Tensor]:
    """Index [B, K] of the point nearest to each keypoint, seen on each of the three planes."""
    found = []
    for plane in _PLANES:
        k, p = keypoints.detach()[..., plane], points.detach()[..., plane]
        search = nearest_reference
        if max_filter_numba.supports(p) and k.dtype == p.dtype:
            search = nearest_numba.nearest_in_plane
        found.append(search(k, p))
    return found


def nearest_reference(
    keypoints: Float[Tensor, "B K 2"], points: Float[Tensor, "B N 2"]
) -> Int[Tensor, "B K"]:
    """The same for one plane in plain PyTorch."""
    # ‖p − k‖² less ‖k‖², which is the same for all points.
    square = torch.baddbmm(points.square().sum(-1)[:, None], keypoints, points.mT, alpha=-2.0)
    return square.argmin(-1)


class PointHead(nn.Module):
    """For each point: its canonical coordinate, the error to expect of it, on the object or not.

    The coordinate is the soft place on the prior plus a residual. The residual starts as the way
    to the point's own place in the predicted frame: at first the prediction is taken as right.
    Canonical coordinates of a rigid object are one similarity of its points; with
    `pose_correction` a pooled feature says by how much the prediction is off, so that the layers
    for single points need not multiply a rotation with a coordinate.
    """

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.anchor, self.corrects = config.canonical_anchor, config.pose_correction
        self.hidden = nn.Linear(2 * config.width + 6, config.width)
        if config.pose_correction and config.canonical_anchor:
            self.correction = PoseCorrection(config.width)
        self.skip = nn.Linear(6, 3, bias=False)
        self.out = nn.Linear(config.width, 5)
        nn.init.zeros_(self.out.weight)
        with torch.no_grad():
            self.skip.weight.copy_(torch.cat([torch.eye(3), -torch.eye(3)], 1))
            self.out.bias.copy_(torch.tensor([0.0, 0.0, 0.0, -2.0, 0.5]))

    def forward(
        self,
        f_obj: Float[Tensor, "B N D"],
        f_aug: Float[Tensor, "B N D"],
        points: Float[Tensor, "B N 3"],
        correspondence: Float[Tensor, "B N 3"],
    ) -> tuple[Float[Tensor, "B N 3"], Float[Tensor, "B N"], Float[Tensor, "B N"]]:
        """Canonical coordinate, log of its expected error, foreground logit."""
        places = torch.cat([points, correspondence], -1)
        out = self.out(F.gelu(self.hidden(torch.cat([f_obj, f_aug, places], -1))))
        canonical = correspondence
        if self.anchor:
            canonical = correspondence + self.skip(places) + out[..., :3]
            if self.corrects:
                canonical = canonical + self.correction(f_obj, f_aug, points, out[..., 4])
        return canonical, out[..., 3].clamp(*_LOG_ERROR_RANGE), out[..., 4]


class PoseCorrection(nn.Module):
    """An affine change of coordinates for a whole view: points · A + b, zero at first."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.local = nn.Linear(2 * width + 3, 2 * width)
        self.hidden = nn.Linear(4 * width, 2 * width)
        self.out = nn.Linear(2 * width, 12)
        nn.init.zeros_(self.out.weight)
        nn.init.zeros_(self.out.bias)

    def forward(
        self,
        f_obj: Float[Tensor, "B N D"],
        f_aug: Float[Tensor, "B N D"],
        points: Float[Tensor, "B N 3"],
        foreground: Float[Tensor, "B N"],
    ) -> Float[Tensor, "B N 3"]:
        """The change of each point's coordinate; the feature is pooled over the object."""
        x = F.gelu(self.local(torch.cat([f_obj, f_aug, points], -1)))
        on_object = torch.sigmoid(foreground.detach())[..., None]
        mean = (on_object * x).sum(1) / on_object.sum(1).clamp_min(1e-3)
        pooled = torch.cat([mean, (on_object * x).amax(1)], -1)
        A, b = self.out(F.gelu(self.hidden(pooled))).split([9, 3], -1)
        return points @ A.unflatten(-1, (3, 3)) + b[:, None]


class KeypointHead(nn.Module):
    """The error to expect of each keypoint, from its features and how far M reaches."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.hidden = nn.Linear(3 * config.plane_width + 2, config.plane_width)
        self.out = nn.Linear(config.plane_width, 1)
        nn.init.zeros_(self.out.weight)
        nn.init.constant_(self.out.bias, -2.0)

    def forward(
        self, features: Float[Tensor, "B K F"], evidence: Float[Tensor, "B K 2"]
    ) -> Float[Tensor, "B K"]:
        x = F.gelu(self.hidden(torch.cat([features, evidence], -1)))
        return self.out(x)[..., 0].clamp(*_LOG_ERROR_RANGE)


def _square_distance(a: Float[Tensor, "B P 3"], b: Float[Tensor, "B Q 3"]) -> Tensor:
    product = a @ b.mT
    square = a.square().sum(-1)[:, :, None] + b.square().sum(-1)[:, None] - 2.0 * product
    return square.clamp_min(0.0)
