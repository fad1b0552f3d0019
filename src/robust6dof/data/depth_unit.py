"""Depth values to metres, and whether the unit can be right."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Float, Float32, UInt16

from robust6dof.errors import DataError

MILLIMETRE = 0.001
"""What one step of a depth image is worth in the field's de-facto layout [m]."""
SATURATED = 65535
"""The value that 7-Scenes and saturated sensors write for "no depth"."""

NEAREST_PLAUSIBLE_M = 0.2
"""A depth image of which nine tenths lie nearer than this is not in the unit assumed [m]."""
FARTHEST_PLAUSIBLE_M = 4.0
"""A depth image of which nine tenths lie farther than this is not in the unit assumed [m]."""


def depth_to_metres(values: UInt16[np.ndarray, "H W"], unit_m: float) -> Float32[np.ndarray, "H W"]:
    """Scale raw depth to metres; 0 and 65535 become 0 (invalid)."""
    return np.where(values == SATURATED, 0, values).astype(np.float32) * np.float32(unit_m)


def metres_to_depth(depth: Float[np.ndarray, "H W"]) -> UInt16[np.ndarray, "H W"]:
    """Round metres to millimetres; what is invalid or beyond 65.534 m becomes 0."""
    millimetres = np.rint(np.nan_to_num(depth.astype(np.float64), posinf=0.0, neginf=0.0) * 1000)
    return np.where((millimetres > 0) & (millimetres < SATURATED), millimetres, 0).astype(np.uint16)


def check_depth_unit(depth: Float32[np.ndarray, "H W"], unit_m: float, path: Path) -> None:
    """Refuse a depth image whose range no table-top or indoor recording has.

    Compares the nearest and the farthest tenth, since a far wall or a hand before the camera
    says nothing about the unit.

    Raises:
        DataError: too near (metres or centimetres stored as integers) or too far (tenths of a
            millimetre, 1/5000 m).
    """
    valid = depth[depth > 0]
    if not valid.size:
        return
    near, far = np.quantile(valid, [0.1, 0.9])
    steps = f"values {near / unit_m:.0f} to {far / unit_m:.0f}, read in steps of {unit_m:g} m,"
    if far < NEAREST_PLAUSIBLE_M:
        raise DataError(
            path,
            f"depth {steps} would lie within {far:.3g} m of the camera",
            "If they are metres or centimetres, store millimetres, or pass depth_unit_m=1.0 or "
            f"0.01; if they are right, pass depth_unit_m={unit_m:g}",
        )
    if near > FARTHEST_PLAUSIBLE_M:
        raise DataError(
            path,
            f"depth {steps} would lie beyond {near:.3g} m",
            "If they are tenths of a millimetre (YCB-Video) pass depth_unit_m=0.0001, for TUM's "
            f"1/5000 m 0.0002; if they are right, pass depth_unit_m={unit_m:g}",
        )
