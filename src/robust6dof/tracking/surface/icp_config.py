"""Settings of the ICP tracker."""

from __future__ import annotations

from dataclasses import dataclass, field

from robust6dof.tracking.states import StateRules
from robust6dof.tracking.surface.frame_cut import CutConfig
from robust6dof.tracking.surface.surroundings import SurroundingsConfig


@dataclass(frozen=True)
class IcpConfig:
    """Lengths called shares are multiplied by the diagonal of the object's box."""

    cut: CutConfig = field(default_factory=CutConfig)
    surroundings: SurroundingsConfig = field(default_factory=SurroundingsConfig)
    voxel_share: float = 0.025
    """Side of the model's voxels, …"""
    voxel_range_m: tuple[float, float] = (0.0025, 0.008)
    """… within these."""
    max_model_points: int = 5000
    cutoff_shares: tuple[float, float, float] = (0.25, 0.10, 0.05)
    """Largest correspondence distance, from coarse to fine, …"""
    cutoff_limits_m: tuple[float, float, float] = (0.06, 0.03, 0.015)
    """… but no more than this."""
    iterations: tuple[int, int, int] = (4, 5, 6)
    """Of each stage, at most."""
    search_share: float = 0.15
    """How far outside the predicted box points are still taken."""
    linear_acceleration: float = 15.0
    """Of the object in the camera frame [m/s²]: the doubt in a constant-velocity prediction, which
    decides only where the images say little."""
    angular_acceleration: float = 50.0
    """[rad/s²]"""
    own_motion_sigmas: float = 4.0
    """The object has left its surroundings where it alone is found as many standard deviations
    from where both are found together, …"""
    own_motion_m: float = 0.002
    """… and at least this far."""
    least_surroundings: float = 0.4
    """Share of the surroundings' points that must fit, or the object has left them, too."""
    own_motion_frames: int = 3
    """After as many such frames in a row the surroundings are forgotten, …"""
    retry_frames: int = 15
    """… and taken up anew after as many more."""
    keyframe_angle_deg: float = 5.0
    """The model takes in a view that differs by this much from all before, …"""
    keyframe_distance_ratio: float = 1.15
    """… or that is nearer by this ratio."""
    settle_frames: int = 5
    """The first frames are all averaged into the model."""
    growth_confidence: float = 0.7
    """The model takes in nothing below this confidence in the shape …"""
    growth_color_gap: float = 0.12
    """… or with colours that differ by more, 0 to 1: a metal lid that darkens is learned."""
    probation_frames: int = 15
    """Found again after a loss, the object is learned from only after as many frames at or above
    that confidence: it may be another one."""
    states: StateRules = field(default_factory=StateRules)
