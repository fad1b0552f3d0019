"""How pairs become a transform."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True)
class SolverConfig:
    """Settings of the solver; lengths as shares of the object's box diagonal."""

    method: Literal["kabsch", "pnp"] = "kabsch"
    """RANSAC and a weighted rigid fit on 3D-3D pairs; or, as printed, PnP and RANSAC on the
    previous frame's 3D and the current frame's pixels, which leaves the current depth unused."""
    inlier_share: float = 0.05
    """An inlier's residual is at most this share of the diagonal."""
    inlier_px: float = 3.0
    """The same for PnP [px]."""
    hypotheses: int = 96
    """RANSAC samples of three pairs."""
    refinements: int = 4
    """Reweighted fits that follow."""
