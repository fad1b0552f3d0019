"""Where the object should be next: constant velocity, damped when the evidence is thin."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from robust6dof.geometry.transforms import make_transform

_NOMINAL_PERIOD = 1.0 / 30.0


@dataclass(frozen=True, eq=False)
class Motion:
    """Velocity of the object in the camera frame, about the object's own centre."""

    linear: Float[np.ndarray, "3"]
    """[m/s], camera axes."""
    angular: Float[np.ndarray, "3"]
    """[rad/s], camera axes."""

    @classmethod
    def at_rest(cls) -> Motion:
        return cls(np.zeros(3), np.zeros(3))

    @classmethod
    def between(cls, T_old: np.ndarray, T_new: np.ndarray, seconds: float) -> Motion:
        """The constant velocity that leads from one `T_cam_obj` to the next."""
        turn = Rotation.from_matrix(T_new[:3, :3] @ T_old[:3, :3].T).as_rotvec()
        return cls((T_new[:3, 3] - T_old[:3, 3]) / seconds, turn / seconds)

    def turning(self, share: Float[np.ndarray, "3 3"]) -> Motion:
        """The same with this share, camera axes, of its turning."""
        return Motion(self.linear, share @ self.angular)

    def predict(
        self, T_cam_obj: Float[np.ndarray, "4 4"], seconds: float
    ) -> Float[np.ndarray, "4 4"]:
        """Carry `T_cam_obj` forward."""
        R_turn = Rotation.from_rotvec(self.angular * seconds).as_matrix()
        return make_transform(R_turn @ T_cam_obj[:3, :3], T_cam_obj[:3, 3] + self.linear * seconds)

    def blended(self, newer: Motion, weight: float) -> Motion:
        """Low-pass filter: `weight` of the newer velocity, the rest of this one."""
        return Motion(
            (1 - weight) * self.linear + weight * newer.linear,
            (1 - weight) * self.angular + weight * newer.angular,
        )


def seconds_between(old: float | None, new: float | None) -> float:
    """Time between two stamps; one period at 30 Hz where stamps are missing or out of order."""
    if old is None or new is None or not 0.0 < new - old < 10.0:
        return _NOMINAL_PERIOD
    return new - old
