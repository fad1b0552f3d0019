"""What the losses compare with: the true change, canonical coordinates, matches, prior in view.

Lengths are in the losses' axes: camera axes about the previous object centre c, over the scale s:
x' = (x − c) / s. The cached features of the previous view were computed in that view's own
predicted frame; its keypoints come here through the camera frame, so that nothing depends on it.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float
from torch import Tensor

from robust6dof.network.inputs import ViewFeatures, to_camera
from robust6dof.network.robust6dof_net import PairOutput


@dataclass(frozen=True, eq=False)
class PairTruth:
    """The truth about B pairs of views."""

    T_cam_obj_prev: Float[Tensor, "B 4 4"]
    """True object frame (rigid, metric) in the previous view's camera."""
    T_cam_obj_cur: Float[Tensor, "B 4 4"]
    """The same in the current view's camera."""
    scale: Float[Tensor, "B"]
    """True box diagonal [m]."""
    symmetric: Bool[Tensor, "B"]
    """A turn about y cannot be seen (bottle, bowl, can; a mug that hides its handle)."""
    on_object_prev: Bool[Tensor, "B N"]
    """Which points of the previous view lie on the object."""
    on_object_cur: Bool[Tensor, "B N"]
    """The same for the current view."""

    def to(self, device: torch.device | str) -> PairTruth:
        """The same on another device."""
        return PairTruth(**{name: value.to(device) for name, value in vars(self).items()})


@dataclass(frozen=True, eq=False)
class ViewTargets:
    """The truth about one view, its free turn about y chosen."""

    R_cam_obj: Float[Tensor, "B 3 3"]
    """Orientation of the canonical frame."""
    t_cam_obj: Float[Tensor, "B 3"]
    """Centre [m]."""
    canonical: Float[Tensor, "B N 3"]
    """True canonical coordinate of each point (only meaningful on the object)."""
    on_object: Bool[Tensor, "B N"]
    """Which points lie on the object."""
    prior_in_view: Bool[Tensor, "B Nr"]
    """Which prior points lie near an observed point of the object."""


@dataclass(frozen=True, eq=False)
class PairTargets:
    """All that the losses compare with; no gradient."""

    previous: ViewTargets
    current: ViewTargets
    R_cur_prev: Float[Tensor, "B 3 3"]
    """ΔR_gt."""
    t_cur_prev: Float[Tensor, "B 3"]
    """ΔT_gt in the losses' axes."""
    centre: Float[Tensor, "B 3"]
    """c: the previous object centre [m]."""
    scale: Float[Tensor, "B"]
    """s: the true scale [m]."""
    matches: Bool[Tensor, "B K K"]
    """M_c^gt: mutual nearest keypoints within the radius, under the true change."""

    def to_loss_axes(self, points_cam: Float[Tensor, "B P 3"]) -> Float[Tensor, "B P 3"]:
        """(x − c) / s."""
        return (points_cam - self.centre[:, None]) / self.scale[:, None, None]


@torch.no_grad()
def make_targets(
    output: PairOutput, truth: PairTruth, match_radius: float = 0.06, view_radius: float = 0.1
) -> PairTargets:
    """Targets of a pair.

    A symmetric object's turn between the views is the one that brings its keypoints closest
    together; the yaw of its canonical frame, a gauge, the one closest to both views' canonical
    coordinates. Both are chosen once and shared by all losses.

    Args:
        output: what the network said (its keypoints and coordinates only choose the free turns).
        truth: the true poses.
        match_radius: how near true matches must be, in diagonals.
        view_radius: how near an observed point a prior point in view is, in diagonals.
    """
    prev, cur = output.previous, output.current
    seen_prev = _in_object_frame(_cloud_cam(prev), truth.T_cam_obj_prev, truth.scale)
    seen_cur = _in_object_frame(_cloud_cam(cur), truth.T_cam_obj_cur, truth.scale)
    turn = _turn_between(
        _in_object_frame(prev.keypoints_cam, truth.T_cam_obj_prev, truth.scale),
        _in_object_frame(cur.keypoints_cam, truth.T_cam_obj_cur, truth.scale),
    )
    R_turn = _about_y(torch.where(truth.symmetric, turn, 0.0))
    # Both clouds in the previous view's gauge, side by side: one yaw for the pair.
    seen = torch.cat([seen_prev, seen_cur @ R_turn], 1)
    said = torch.cat([prev.canonical, cur.canonical], 1)
    weight = torch.cat([truth.on_object_prev, truth.on_object_cur], 1).float()
    R_gauge = _about_y(torch.where(truth.symmetric, _turn_between(seen, said, weight), 0.0))
    R_prev, R_cur = truth.T_cam_obj_prev[:, :3, :3], truth.T_cam_obj_cur[:, :3, :3]
    canonical = (seen @ R_gauge.mT).split([seen_prev.shape[1], seen_cur.shape[1]], 1)
    R_cur_prev = R_cur @ R_turn @ R_prev.mT
    centre = truth.T_cam_obj_prev[:, :3, 3]
    t_cur_prev = (truth.T_cam_obj_cur[:, :3, 3] - centre) / truth.scale[:, None]

    def view(R: Tensor, T: Tensor, coordinates: Tensor, on_object: Tensor) -> ViewTargets:
        near = _prior_in_view(output.prior.points, coordinates, on_object, view_radius)
        return ViewTargets(R @ R_gauge.mT, T[:, :3, 3], coordinates, on_object, near)

    moved = ((prev.keypoints_cam - centre[:, None]) / truth.scale[:, None, None]) @ R_cur_prev.mT
    moved = moved + t_cur_prev[:, None]
    found = (cur.keypoints_cam - centre[:, None]) / truth.scale[:, None, None]
    return PairTargets(
        previous=view(R_prev, truth.T_cam_obj_prev, canonical[0], truth.on_object_prev),
        current=view(R_cur @ R_turn, truth.T_cam_obj_cur, canonical[1], truth.on_object_cur),
        R_cur_prev=R_cur_prev,
        t_cur_prev=t_cur_prev,
        centre=centre,
        scale=truth.scale,
        matches=_mutual_nearest(moved, found, match_radius),
    )


def _cloud_cam(view: ViewFeatures) -> Tensor:
    return to_camera(view.points, view.T_cam_pred, view.scale)


def _in_object_frame(points_cam: Tensor, T_cam_obj: Tensor, scale: Tensor) -> Tensor:
    return (points_cam - T_cam_obj[:, None, :3, 3]) @ T_cam_obj[:, :3, :3] / scale[:, None, None]


def _turn_between(src: Tensor, dst: Tensor, weight: Tensor | None = None) -> Tensor:
    """Angle [B] about y that brings src [B P 3] closest to dst, in closed form."""
    w = torch.ones_like(src[..., 0]) if weight is None else weight
    sine = (w * (dst[..., 0] * src[..., 2] - dst[..., 2] * src[..., 0])).sum(1)
    cosine = (w * (dst[..., 0] * src[..., 0] + dst[..., 2] * src[..., 2])).sum(1)
    return torch.atan2(sine, cosine)


def _about_y(angle: Tensor) -> Tensor:
    zero, one = torch.zeros_like(angle), torch.ones_like(angle)
    c, s = angle.cos(), angle.sin()
    return torch.stack([c, zero, s, zero, one, zero, -s, zero, c], -1).unflatten(-1, (3, 3))


def _prior_in_view(prior: Tensor, canonical: Tensor, on_object: Tensor, radius: float) -> Tensor:
    distance = torch.cdist(prior, canonical)
    return distance.masked_fill(~on_object[:, None], torch.inf).amin(2) <= radius


def _mutual_nearest(src: Tensor, dst: Tensor, radius: float) -> Tensor:
    distance = torch.cdist(src, dst)
    is_row_best = distance == distance.amin(2, keepdim=True)
    is_column_best = distance == distance.amin(1, keepdim=True)
    return is_row_best & is_column_best & (distance <= radius)
