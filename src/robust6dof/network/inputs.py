"""What the network is given, and what it keeps of a view: one definition for training and tracking.

A view's points are stated in the *predicted* object frame, divided by the predicted scale, so that
the network sees a near-canonical cloud wherever the camera is. `T_cam_pred` and `scale` map back:
p_cam = R_cam_pred (scale · p) + t_cam_pred.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from typing import TypeVar

import torch
from jaxtyping import Float
from torch import Tensor

BatchT = TypeVar("BatchT", bound="_Batch")


class _Batch:
    """Stack, move and split a dataclass whose fields are tensors with the batch in front."""

    def to(self: BatchT, device: torch.device | str) -> BatchT:
        """The same on another device."""
        return self._map(lambda value: value.to(device))

    def detach(self: BatchT) -> BatchT:
        """The same without its graph."""
        return self._map(lambda value: value.detach())

    def __getitem__(self: BatchT, index: slice) -> BatchT:
        """A slice of the batch."""
        return self._map(lambda value: value[index])

    @classmethod
    def cat(cls: type[BatchT], parts: Sequence[BatchT]) -> BatchT:
        """Several batches one after another."""
        names = [field.name for field in fields(cls)]  # pyright: ignore[reportArgumentType]
        return cls(**{name: torch.cat([getattr(part, name) for part in parts]) for name in names})

    def _map(self: BatchT, function: Callable[[Tensor], Tensor]) -> BatchT:
        names = [field.name for field in fields(self)]  # pyright: ignore[reportArgumentType]
        return type(self)(**{name: function(getattr(self, name)) for name in names})


@dataclass(frozen=True, eq=False)
class ViewBatch(_Batch):
    """B views of one object each."""

    points: Float[Tensor, "B N 3"]
    """Observed points in the predicted object frame over the predicted scale (about ±0.5)."""
    rgb: Float[Tensor, "B 3 S S"]
    """Colour crop, 0 to 1; all zeros where the camera has no colour."""
    pixels: Float[Tensor, "B N 2"]
    """(x, y) of each point's pixel in the crop [px], centres at integers."""
    T_cam_pred: Float[Tensor, "B 4 4"]
    """Predicted object frame in the camera (rigid, metric)."""
    scale: Float[Tensor, "B"]
    """Predicted box diagonal [m]."""


@dataclass(frozen=True, eq=False)
class PriorFeatures(_Batch):
    """The categorical prior encoded: once per track."""

    points: Float[Tensor, "B Nr 3"]
    """P_r, canonical coordinates."""
    features: Float[Tensor, "B Nr D"]
    """F_pr."""
    anchors: Float[Tensor, "B K 3"]
    """The n prior points spread farthest apart, one for each keypoint."""
    anchor_features: Float[Tensor, "B K D"]
    """F_pr at the anchors."""


@dataclass(frozen=True, eq=False)
class ViewFeatures(_Batch):
    """All that later steps need of a view; cached, so that a step encodes only the new frame."""

    points: Float[Tensor, "B N 3"]
    """The view's points, as given."""
    f_obj: Float[Tensor, "B N D"]
    """F̃_obj, which the next frame's temporal encoder reads."""
    correspondence: Float[Tensor, "B N 3"]
    """S̄_pr P_r: each point's soft place on the prior."""
    canonical: Float[Tensor, "B N 3"]
    """Canonical coordinate of each point (the soft place plus a residual)."""
    log_error: Float[Tensor, "B N"]
    """Log of the error expected of `canonical`, in diagonals."""
    foreground: Float[Tensor, "B N"]
    """Logit: does the point lie on the object?"""
    assignment: Float[Tensor, "B K N"]
    """M; rows sum to 1."""
    keypoints: Float[Tensor, "B K 3"]
    """k = M P in the view's own predicted frame, over the scale."""
    keypoint_features: Float[Tensor, "B K F"]
    """F̃_kp from the three planes, unit length."""
    keypoint_canonical: Float[Tensor, "B K 3"]
    """Canonical coordinate of each keypoint."""
    keypoint_log_error: Float[Tensor, "B K"]
    """Log of the error expected of each keypoint, in diagonals."""
    keypoints_cam: Float[Tensor, "B K 3"]
    """The keypoints in the camera frame [m]."""
    T_cam_pred: Float[Tensor, "B 4 4"]
    """As in the view."""
    scale: Float[Tensor, "B"]
    """As in the view [m]."""

    @property
    def point_weight(self) -> Float[Tensor, "B N"]:
        """Weight of each point in the absolute fit: on the object, over the expected error²."""
        return torch.sigmoid(self.foreground) * torch.exp(-2.0 * self.log_error)

    @property
    def keypoint_weight(self) -> Float[Tensor, "B K"]:
        """Weight of each keypoint in a fit: one over the expected error²."""
        return torch.exp(-2.0 * self.keypoint_log_error)


def to_camera(
    points: Float[Tensor, "B P 3"], T_cam_pred: Float[Tensor, "B 4 4"], scale: Float[Tensor, "B"]
) -> Float[Tensor, "B P 3"]:
    """Map points of the predicted frame, in diagonals, to the camera frame [m]."""
    R_cam_pred, t_cam_pred = T_cam_pred[:, :3, :3], T_cam_pred[:, :3, 3]
    return scale[:, None, None] * points @ R_cam_pred.mT + t_cam_pred[:, None]


def farthest_points(points: Float[Tensor, "B P 3"], count: int) -> Tensor:
    """Indices [B, count] of a spread-out subset, starting farthest from the mean."""
    distance = (points - points.mean(1, keepdim=True)).square().sum(-1)
    nearest = torch.full_like(distance, torch.inf)
    chosen = []
    for _ in range(count):
        index = (distance if not chosen else nearest).argmax(1)
        chosen.append(index)
        centre = points.gather(1, index[:, None, None].expand(-1, 1, 3))
        nearest = torch.minimum(nearest, (points - centre).square().sum(-1))
    return torch.stack(chosen, 1)


def gather_rows(values: Float[Tensor, "B P C"], index: Tensor) -> Tensor:
    """Rows [B, Q, C] of values at index [B, Q]."""
    return values.gather(1, index[..., None].expand(-1, -1, values.shape[-1]))
