"""A gyro's angular velocities, integrated to orientations of the camera.

The orientation's reference is any frame that stands still; it may drift, since only the turn from
one image to the next is used.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from robust6dof.errors import InputError

FASTEST = 35.0
"""No camera turns faster [rad/s]: 2000 °/s, the usual full scale of such gyros."""


def turned(
    R_ref_cam: Float[np.ndarray, "3 3"], rate: Float[np.ndarray, "3"], seconds: float
) -> Float[np.ndarray, "3 3"]:
    """The camera's orientation after `seconds` at this angular velocity.

    Args:
        R_ref_cam: before; the identity to begin with.
        rate: angular velocity of the camera [rad/s], camera axes (x right, y down, z forward).
        seconds: how long.

    Raises:
        InputError: not a rate in rad/s.
    """
    return R_ref_cam @ _matrix(check_rates(rate) * seconds)


def integrate_rates(
    stamps: Float[np.ndarray, "S"], rates: Float[np.ndarray, "S 3"], at: Float[np.ndarray, "F"]
) -> list[Float[np.ndarray, "3 3"] | None]:
    """Orientations of the camera at some times; None at those before or after all samples.

    The rate between two samples is taken as linear in time.

    Args:
        stamps: of the samples [s], increasing, two at least.
        rates: angular velocity of the camera [rad/s], camera axes.
        at: when [s].

    Raises:
        InputError: not rates in rad/s.
    """
    rates = check_rates(rates)
    means, seconds = (rates[:-1] + rates[1:]) / 2, np.diff(stamps)
    R_ref_sample = [np.eye(3)]
    for step in _matrix(means * seconds[:, None]):
        R_ref_sample.append(R_ref_sample[-1] @ step)

    def orientation(time: float) -> np.ndarray | None:
        if not stamps[0] <= time <= stamps[-1]:
            return None
        last = int(np.searchsorted(stamps, time, side="right")) - 1
        here = np.array([np.interp(time, stamps, rates[:, axis]) for axis in range(3)])
        mean = (rates[last] + here) / 2
        return R_ref_sample[last] @ _matrix(mean * (time - stamps[last]))

    return [orientation(float(time)) for time in at]


def check_rates(rates: np.ndarray) -> Float[np.ndarray, "*N 3"]:
    """Return angular velocities as float64.

    Raises:
        InputError: not of three axes, not finite, or faster than any camera.
    """
    clean = np.asarray(rates, dtype=np.float64)
    if clean.ndim == 0 or clean.shape[-1] != 3:
        raise InputError(f"angular velocities have three axes, got shape {clean.shape}")
    if not np.isfinite(clean).all():
        raise InputError("the angular velocity contains NaN or infinity")
    fastest = float(np.linalg.norm(clean, axis=-1).max(initial=0.0))
    if fastest > FASTEST:
        raise InputError(
            f"{fastest:.0f} rad/s is faster than any camera turns: in degrees per second? "
            "Multiply by π/180"
        )
    return clean


def _matrix(rotvec: np.ndarray) -> np.ndarray:
    return Rotation.from_rotvec(rotvec).as_matrix()
