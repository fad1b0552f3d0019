"""Stage 2: shape-based spatial-temporal augmentation. F̃_obj → F̃_temp → F̃_aug."""

from __future__ import annotations

import torch
from jaxtyping import Float
from torch import Tensor, nn

from robust6dof.network.attention import FeedForward, MultiHead, weighted_sum
from robust6dof.network.config import NetworkConfig
from robust6dof.network.fusion import PointStem
from robust6dof.network.inputs import PriorFeatures, farthest_points, gather_rows
from robust6dof.network.max_filter import max_filter


def similarity_scale(config: NetworkConfig) -> float:
    """What inner products are multiplied by before the softmax."""
    return config.width**-0.5 if config.similarity == "scaled" else 1.0


class PriorEncoder(nn.Module):
    """The learnable layer that makes F_pr of the prior's points."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.keypoints = min(config.keypoints, config.prior_points)
        self.stem = PointStem(config.width)

    def forward(self, points: Float[Tensor, "B Nr 3"]) -> PriorFeatures:
        features = self.stem(points)
        index = farthest_points(points, self.keypoints)
        return PriorFeatures(
            points=points,
            features=features,
            anchors=gather_rows(points, index),
            anchor_features=gather_rows(features, index),
        )


class TemporalEncoder(nn.Module):
    """STE with temporal dynamic filtering.

    Ḟ = Norm(F_obj + MultiHead(F_obj, F_obj, F_obj)); F̈ the maximum filter of the previous frame's
    F_obj with the softmax of <ḟ_i, f_j(t−1)>; F_temp = Norm(F̈ + MultiHead(Ḟ, F̈, F̈)).
    """

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        width = config.width
        self.scale = similarity_scale(config)
        self.attention = MultiHead(width, config.heads)
        self.norm = nn.LayerNorm(width)
        # F([a; b]) = W₁ a + W₂ b + bias: the two halves of one linear layer.
        self.from_previous = nn.Linear(width, width, bias=False)
        self.from_current = nn.Linear(width, width)
        self.cross_attention = MultiHead(width, config.heads)
        self.cross_norm = nn.LayerNorm(width)

    def forward(
        self, f_obj: Float[Tensor, "B N D"], f_previous: Float[Tensor, "B M D"]
    ) -> Float[Tensor, "B N D"]:
        attended = self.norm(f_obj + self.attention(f_obj, f_obj))
        filtered = max_filter(
            attended, f_previous, self.from_previous(f_previous), scale=self.scale
        ) + self.from_current(f_obj)
        return self.cross_norm(filtered + self.cross_attention(attended, filtered))


class ShapeFilter(nn.Module):
    """SSF: F⃛ from the prior's features and coordinates, by their similarity to each point."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.reading = config.shape_filter
        self.scale = similarity_scale(config)
        self.from_feature = nn.Linear(config.width, config.width, bias=False)
        self.from_coordinate = nn.Linear(3, config.width)

    def forward(
        self, f_obj: Float[Tensor, "B N D"], prior: PriorFeatures
    ) -> tuple[Float[Tensor, "B N D"], Float[Tensor, "B N 3"]]:
        """F⃛ and S̄_pr P_r, the soft place of each point on the prior."""
        value, offset = self.from_feature(prior.features), self.from_coordinate(prior.points)
        if self.reading == "max":
            filtered = max_filter(f_obj, prior.features, value, offset, self.scale)
            return filtered, weighted_sum(f_obj, prior.features, prior.points, self.scale)
        both = torch.cat([value + offset, prior.points], -1)
        found = weighted_sum(f_obj, prior.features, both, self.scale)
        return found[..., :-3], found[..., -3:]


class AugmentationDecoder(nn.Module):
    """AD: F_aug = Norm(F⃛ + MultiHead(F⃛, F_temp, F_temp)); F̃_aug = Norm(F_aug + FFN(F_aug))."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.attention = MultiHead(config.width, config.heads)
        self.norm = nn.LayerNorm(config.width)
        self.feed_forward = FeedForward(config.width, config.ffn_ratio)
        self.out_norm = nn.LayerNorm(config.width)

    def forward(
        self, query: Float[Tensor, "B N D"], f_temp: Float[Tensor, "B N D"]
    ) -> Float[Tensor, "B N D"]:
        augmented = self.norm(query + self.attention(query, f_temp))
        return self.out_norm(augmented + self.feed_forward(augmented))


class Augmentation(nn.Module):
    """All of stage 2, with its switches."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.scale = similarity_scale(config)
        self.temporal = TemporalEncoder(config) if config.temporal_encoder else None
        self.shape = ShapeFilter(config) if config.shape_filter != "off" else None
        self.decoder = AugmentationDecoder(config) if config.augmentation_decoder else None

    def forward(
        self,
        f_obj: Float[Tensor, "B N D"],
        f_previous: Float[Tensor, "B M D"],
        prior: PriorFeatures,
    ) -> tuple[Float[Tensor, "B N D"], Float[Tensor, "B N D"], Float[Tensor, "B N 3"]]:
        """F̃_temp, F̃_aug and the soft place of each point on the prior, S̄_pr P_r."""
        f_temp = self.temporal(f_obj, f_previous) if self.temporal else f_obj
        if self.shape:
            query, place = self.shape(f_obj, prior)
        else:
            query = f_temp
            place = weighted_sum(f_obj, prior.features, prior.points, self.scale)
        f_aug = self.decoder(query, f_temp) if self.decoder else query
        return f_temp, f_aug, place
