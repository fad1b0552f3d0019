"""What kind of data a figure was measured on: it must say so."""

from __future__ import annotations

import json
from pathlib import Path

RECORDED = "recorded images"


def data_kind(path: Path) -> str:
    """What kind of data a folder holds, in words."""
    files = (file for pattern in ("plan.json", "*/plan.json") for file in path.glob(pattern))
    first = next(files, None)
    if first is None:
        return RECORDED
    plan = json.loads(first.read_text())
    if "video" in plan:
        return "YCB-Video re-rendered: real trajectories, scanned shapes, synthetic images"
    if plan.get("mesh"):
        return "synthetic images and motion of meshes that were given"
    return "synthetic: procedural shapes, simulated motion and sensor (AerialPose-Sim)"
