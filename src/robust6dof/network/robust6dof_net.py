"""The network: `forward` reads as the paper's figure, `encode` is one frame of it."""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Float
from torch import Tensor, nn

from robust6dof.network.augmentation import Augmentation, PriorEncoder
from robust6dof.network.config import NetworkConfig
from robust6dof.network.fusion import DenseFusion
from robust6dof.network.inputs import PriorFeatures, ViewBatch, ViewFeatures, to_camera
from robust6dof.network.keypoints import (
    AssignmentHead,
    KeypointHead,
    PointHead,
    TriPlane,
    UnsupervisedKeypoints,
)
from robust6dof.network.matching import KeypointMatches, match_views


@dataclass(frozen=True, eq=False)
class PairOutput:
    """What the network says of two views."""

    previous: ViewFeatures
    current: ViewFeatures
    matches: KeypointMatches
    prior: PriorFeatures


class Robust6DofNet(nn.Module):
    """Robust6DoF: one network for all categories, conditioned on the category's prior."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.config = config
        self.prior_encoder = PriorEncoder(config)
        self.fusion = DenseFusion(config)
        self.augmentation = Augmentation(config)
        self.point_head = PointHead(config)
        if config.keypoint_source == "unsupervised":
            self.unsupervised = UnsupervisedKeypoints(config)
        else:
            self.assignment = AssignmentHead(config)
        self.triplane = TriPlane(config)
        self.keypoint_head = KeypointHead(config)

    def forward(
        self, previous: ViewBatch, current: ViewBatch, prior: Float[Tensor, "B Nr 3"]
    ) -> PairOutput:
        """Two views at once, for training; equal to `encode` one after the other.

        The first view has no past: it is its own previous frame.
        """
        prior_features = self.encode_prior(prior)
        both = ViewBatch.cat([previous, current])
        f_obj = self.fusion(both)
        f_first = f_obj[: len(prior)]
        features = self._finish(
            both,
            f_obj,
            torch.cat([f_first, f_first]),
            PriorFeatures.cat([prior_features, prior_features]),
        )
        first, second = features[: len(prior)], features[len(prior) :]
        return PairOutput(first, second, self.match(first, second), prior_features)

    def encode_prior(self, prior: Float[Tensor, "B Nr 3"]) -> PriorFeatures:
        """Encode the categorical prior (canonical points, diagonal 1): once per track."""
        return self.prior_encoder(prior)

    def encode(
        self, view: ViewBatch, prior: PriorFeatures, previous: ViewFeatures | None = None
    ) -> ViewFeatures:
        """Encode one frame; `previous` is the last frame's result (None on the first)."""
        f_obj = self.fusion(view)
        return self._finish(view, f_obj, f_obj if previous is None else previous.f_obj, prior)

    def match(self, previous: ViewFeatures, current: ViewFeatures) -> KeypointMatches:
        """Match the keypoints of any two encoded views."""
        return match_views(previous, current, self.config.match_temperature)

    def _finish(
        self,
        view: ViewBatch,
        f_obj: Float[Tensor, "B N D"],
        f_previous: Float[Tensor, "B M D"],
        prior: PriorFeatures,
    ) -> ViewFeatures:
        """Stages 2 and 3 of one frame."""
        f_temp, f_aug, correspondence = self.augmentation(f_obj, f_previous, prior)
        canonical, log_error, foreground = self.point_head(
            f_obj, f_aug, view.points, correspondence
        )
        if self.config.keypoint_source == "unsupervised":
            regressed, assignment = self.unsupervised(f_aug, view.points)
        else:
            regressed = None
            assignment = self.assignment(f_obj, f_temp, f_aug, canonical, foreground, prior)
        values = torch.cat([view.points.mT, canonical.mT, log_error[:, None]], 1)
        place, keypoint_canonical, expected = (assignment @ values.mT).split([3, 3, 1], -1)
        keypoints = place if regressed is None else regressed
        features = self.triplane(keypoints, view.points, torch.cat([f_obj, f_temp, f_aug], -1))
        return ViewFeatures(
            points=view.points,
            f_obj=f_obj,
            correspondence=correspondence,
            canonical=canonical,
            log_error=log_error,
            foreground=foreground,
            assignment=assignment,
            keypoints=keypoints,
            keypoint_features=features,
            keypoint_canonical=keypoint_canonical,
            keypoint_log_error=self._expect_error(features, expected, prior, keypoint_canonical),
            keypoints_cam=to_camera(keypoints, view.T_cam_pred, view.scale),
            T_cam_pred=view.T_cam_pred,
            scale=view.scale,
        )

    def _expect_error(
        self,
        features: Tensor,
        expected: Float[Tensor, "B K 1"],
        prior: PriorFeatures,
        keypoint_canonical: Tensor,
    ) -> Float[Tensor, "B K"]:
        """Expected keypoint error from its features, its points' errors, how near its anchor."""
        expected = expected.detach()
        reach = torch.zeros_like(expected)
        if self.config.keypoint_source == "prior":
            reach = (keypoint_canonical - prior.anchors).norm(dim=-1, keepdim=True).detach()
        return self.keypoint_head(features, torch.cat([expected, reach], -1))
