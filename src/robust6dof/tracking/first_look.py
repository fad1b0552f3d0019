"""The first frame, looked at from several guesses: which of them does the network confirm?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from jaxtyping import Float

from robust6dof.errors import InputError
from robust6dof.frames import RgbdFrame
from robust6dof.solver.absolute import AbsoluteFit
from robust6dof.tracking.canonical_frame import Doubt
from robust6dof.tracking.disagreement import Disagreement
from robust6dof.tracking.encoder import ViewEncoder
from robust6dof.tracking.initialisation import NOTHING_THERE
from robust6dof.tracking.prior_residuals import InitialPose


@dataclass(frozen=True)
class FirstLookConfig:
    """How the first frame is searched."""

    passes: int = 3
    """Looks from each guess, each from where the last one put the object."""
    reach: float = 1.5
    """Guesses lie as many standard deviations of the start's place to each side; …"""
    worth_m: float = 0.01
    """… only the start itself is tried where that deviation is smaller than this [m]."""
    evidence: float = 4.0
    """What the logarithm of the network's support counts against the doubt in the start."""


@dataclass(frozen=True, eq=False)
class _Found:
    anchor: AbsoluteFit
    score: float


def look_around(
    encoder: ViewEncoder,
    frame: RgbdFrame,
    initial: InitialPose,
    doubt: Doubt,
    config: FirstLookConfig,
) -> AbsoluteFit:
    """The pose that the network confirms best, the start's own likelihood considered.

    Args:
        encoder: the network.
        frame: the first image.
        initial: the pose and extents to begin with.
        doubt: in these.
        config: how far to search.

    Raises:
        InputError: no depth near the start.
    """
    offsets = np.zeros((1, 3))
    if doubt.translation >= config.worth_m:
        sides = config.reach * doubt.translation * np.eye(3)
        offsets = np.concatenate([offsets, sides, -sides])
    found = [_follow(encoder, frame, initial, offset, doubt, config) for offset in offsets]
    confirmed = [one for one in found if one is not None]
    if not confirmed:
        raise InputError(NOTHING_THERE)
    return max(confirmed, key=lambda one: one.score).anchor


def _follow(
    encoder: ViewEncoder,
    frame: RgbdFrame,
    initial: InitialPose,
    offset: Float[np.ndarray, "3"],
    doubt: Doubt,
    config: FirstLookConfig,
) -> _Found | None:
    """Looks from one guess until it settles."""
    start_scale = float(np.linalg.norm(initial.extents))
    T_cam_pred, scale = initial.T_cam_obj.copy(), start_scale
    T_cam_pred[:3, 3] += offset
    anchor, support = None, 0.0
    for number in range(config.passes):
        extents = initial.extents * (scale / start_scale)
        features = encoder.encode(frame, T_cam_pred, extents, None, number)
        if features is None:
            return None
        anchor = encoder.anchor(features, number)
        support = anchor.inlier_share * float(torch.sigmoid(features.foreground).mean())
        T_cam_pred = anchor.T_cam_obj
        scale = float(np.clip(anchor.scale, 0.5 * start_scale, 2.0 * start_scale))
    if anchor is None:
        return None
    apart = Disagreement.between(
        initial.T_cam_obj, start_scale, anchor.T_cam_obj, scale, encoder.symmetric
    )
    score = config.evidence * float(np.log(support + 1e-6)) - _surprise(apart, doubt)
    return _Found(anchor, score)


def _surprise(apart: Disagreement, doubt: Doubt) -> float:
    """Minus the log likelihood of the start, if the pose so far from it were true."""
    turn = apart.rotation / max(doubt.rotation, 1e-3)
    shift = apart.translation / max(doubt.translation, 1e-4)
    return 0.5 * (turn**2 + shift**2 + (apart.log_scale / max(doubt.scale, 1e-3)) ** 2)
