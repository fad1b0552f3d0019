"""Trackers by name, for the command line and the evaluation."""

from __future__ import annotations

from collections.abc import Callable

from robust6dof.errors import InputError
from robust6dof.frames import PoseTracker


def make_tracker(name: str, category: str, *, seed: int = 0) -> PoseTracker:
    """A tracker that needs no trained weights.

    Args:
        name: one of TRACKERS.
        category: of the object; decides the prior that it starts from.
        seed: of everything random in it.

    Raises:
        InputError: an unknown name.
    """
    if name not in TRACKERS:
        raise InputError(f"no tracker '{name}'; there is: {', '.join(TRACKERS)}")
    return TRACKERS[name](category, seed)


def _icp(category: str, seed: int) -> PoseTracker:
    from robust6dof.tracking.surface.icp import IcpTracker

    return IcpTracker(category, seed=seed)


def _static(category: str, seed: int) -> PoseTracker:
    from robust6dof.baselines.static import StaticTracker

    return StaticTracker(category)


TRACKERS: dict[str, Callable[[str, int], PoseTracker]] = {"icp": _icp, "static": _static}
"""Name → maker (category, seed)."""
