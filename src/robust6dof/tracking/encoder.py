"""One object in one frame through the network: its features and its own absolute pose."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from jaxtyping import Float

from robust6dof.errors import InputError
from robust6dof.frames import SYMMETRIC_CATEGORIES, RgbdFrame
from robust6dof.network.inputs import PriorFeatures, ViewBatch, ViewFeatures, to_camera
from robust6dof.network.robust6dof_net import Robust6DofNet
from robust6dof.shapes.priors import load_prior
from robust6dof.solver.absolute import AbsoluteFit, fit_absolute
from robust6dof.tracking.initialisation import NOTHING_THERE
from robust6dof.tracking.pretrained import load_pretrained
from robust6dof.tracking.view import ViewConfig, make_view


@dataclass(frozen=True, eq=False)
class ViewRequest:
    """What one view asks of the network: a batch of one in each field."""

    view: ViewBatch
    prior: PriorFeatures
    previous: ViewFeatures | None
    """Of the last frame, for the temporal encoder; None without a past."""


@torch.inference_mode()
def encode_together(net: Robust6DofNet, requests: Sequence[ViewRequest]) -> list[ViewFeatures]:
    """The features of each request, in one call of the network; all with a past, or none."""
    if not requests:
        return []
    past = [request.previous for request in requests if request.previous is not None]
    features = net.encode(
        ViewBatch.cat([request.view for request in requests]),
        PriorFeatures.cat([request.prior for request in requests]),
        ViewFeatures.cat(past) if past else None,
    )
    if len(requests) == 1:
        return [features]
    return [ViewFeatures.cat([features[i : i + 1]]) for i in range(len(requests))]


def encode_alone(net: Robust6DofNet, request: ViewRequest | None) -> ViewFeatures | None:
    """The features of one request; None without one."""
    return None if request is None else encode_together(net, [request])[0]


class ViewEncoder:
    """The network with a category's prior encoded once.

    Args:
        net: the network; it is set to evaluation.
        prior: the category's shape prior, canonical points of diagonal 1.
        category: its name; decides the symmetry.
        seed: of the points drawn and of RANSAC.
    """

    def __init__(
        self, net: Robust6DofNet, prior: Float[np.ndarray, "P 3"], category: str, seed: int = 0
    ) -> None:
        self.net = net.eval()
        self.category = category
        self.prior = prior
        self.symmetric = category in SYMMETRIC_CATEGORIES
        self.seed = seed
        self._view = ViewConfig(points=net.config.points, crop_px=net.config.crop_px)
        self._prior = _encode_prior(net, prior, seed)

    @classmethod
    def from_pretrained(
        cls, path: str | Path | None, category: str, device: str = "auto", seed: int = 0
    ) -> ViewEncoder:
        """With the shipped weights, or with one's own; see `load_pretrained`."""
        prior = load_prior(category)
        return cls(load_pretrained(path, device, category), prior, category, seed)

    def request(
        self,
        frame: RgbdFrame,
        T_cam_pred: Float[np.ndarray, "4 4"],
        extents: Float[np.ndarray, "3"],
        previous: ViewFeatures | None,
        number: int,
    ) -> ViewRequest | None:
        """To look at what the prediction says is the object; None where there is no depth.

        Args:
            frame: the image.
            T_cam_pred: predicted object frame in the camera.
            extents: predicted side lengths [m].
            previous: of the last frame, for the temporal encoder.
            number: of the frame; with the seed it decides which points are drawn.
        """
        rng = np.random.default_rng([self.seed, number])
        view = make_view(frame, T_cam_pred, extents, self._view, rng)
        if view is None:
            return None
        return ViewRequest(view.batch.to(self._prior.points.device), self._prior, previous)

    def encode(
        self,
        frame: RgbdFrame,
        T_cam_pred: Float[np.ndarray, "4 4"],
        extents: Float[np.ndarray, "3"],
        previous: ViewFeatures | None,
        number: int,
    ) -> ViewFeatures | None:
        """The features of one such `request`."""
        request = self.request(frame, T_cam_pred, extents, previous, number)
        return encode_alone(self.net, request)

    def anchor(self, features: ViewFeatures, number: int) -> AbsoluteFit:
        """The absolute pose that one view's canonical coordinates give."""
        rng = np.random.default_rng([self.seed, number, 2])
        points_cam = to_camera(features.points, features.T_cam_pred, features.scale)
        parts = (features.canonical, points_cam, features.point_weight)
        canonical, points, weight = (part[0].double().cpu().numpy() for part in parts)
        return fit_absolute(canonical, points, weight, rng)

    def first(
        self,
        frame: RgbdFrame,
        T_cam_obj: Float[np.ndarray, "4 4"],
        extents: Float[np.ndarray, "3"],
        number: int = 0,
    ) -> ViewFeatures:
        """`encode` without a past.

        Raises:
            InputError: no depth there.
        """
        features = self.encode(frame, T_cam_obj, extents, None, number)
        if features is None:
            raise InputError(NOTHING_THERE)
        return features


@torch.inference_mode()
def _encode_prior(net: Robust6DofNet, prior: Float[np.ndarray, "P 3"], seed: int) -> PriorFeatures:
    count = net.config.prior_points
    rng = np.random.default_rng(seed)
    chosen = rng.choice(len(prior), count, replace=len(prior) < count)
    device = next(net.parameters()).device
    points = torch.from_numpy(np.asarray(prior[chosen], dtype=np.float32))[None].to(device)
    return net.encode_prior(points)
