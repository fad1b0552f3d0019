"""Where the object should be next: constant velocity, and the camera's own turn where a gyro tells.

With a gyro, what goes on at constant velocity is the rest of the motion: the object's turn beyond
that of the camera, and its shift. How far a turn of the camera shifts the object differs: by all of
it where the camera alone turns, by little where it is swung about the object. That share is learned
from the changes of both velocities.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from robust6dof.geometry.transforms import make_transform

_NOMINAL_PERIOD = 1.0 / 30.0
_USUAL_SHARE = 0.3
"""Of a turn of the camera that shifts the object, before it is known, …"""
_USUAL_WEIGHT = 0.1
"""… and how much this counts: like so many squared changes of velocity [m²/s²]."""
_SHARE_MEMORY = 0.95
"""By this the past counts less with each frame."""


@dataclass(frozen=True)
class ShiftShare:
    """Which share of the shift that the camera's turn alone would give is really there: a line
    through the changes of both velocities, by least squares."""

    products: float = _USUAL_SHARE * _USUAL_WEIGHT
    squares: float = _USUAL_WEIGHT

    @property
    def value(self) -> float:
        return float(np.clip(self.products / self.squares, 0.0, 1.0))

    def learned(self, turned: Float[np.ndarray, "3"], moved: Float[np.ndarray, "3"]) -> ShiftShare:
        """With one more change of the velocity by the turn alone, and of that seen [m/s]."""
        usual, keep = ShiftShare(), _SHARE_MEMORY
        products = usual.products + keep * (self.products - usual.products) + turned @ moved
        squares = usual.squares + keep * (self.squares - usual.squares) + turned @ turned
        return ShiftShare(float(products), float(squares))


@dataclass(frozen=True, eq=False)
class CameraTurn:
    """What the gyro says of the last frames."""

    R_ref_cam: Float[np.ndarray, "3 3"]
    """At the last frame."""
    linear: Float[np.ndarray, "3"] = field(default_factory=lambda: np.zeros(3))
    """Velocity in the camera of a still point where the object is, if the camera did nothing but
    turn [m/s]."""
    angular: Float[np.ndarray, "3"] = field(default_factory=lambda: np.zeros(3))
    """Of all that stands still, in the camera [rad/s]."""
    share: ShiftShare = field(default_factory=ShiftShare)

    def applied(
        self, T_cam_obj: Float[np.ndarray, "4 4"], R_ref_cam: Float[np.ndarray, "3 3"]
    ) -> Float[np.ndarray, "4 4"]:
        """A still object after the camera turned to `R_ref_cam` and did nothing else."""
        turn = R_ref_cam.T @ self.R_ref_cam
        return make_transform(turn @ T_cam_obj[:3, :3], turn @ T_cam_obj[:3, 3])

    def blended(
        self, newer: CameraTurn, weight: float, moved: Float[np.ndarray, "3"]
    ) -> CameraTurn:
        return CameraTurn(
            newer.R_ref_cam,
            (1 - weight) * self.linear + weight * newer.linear,
            (1 - weight) * self.angular + weight * newer.angular,
            self.share.learned(newer.linear - self.linear, moved),
        )


@dataclass(frozen=True, eq=False)
class Motion:
    """Velocity of the object in the camera frame, about the object's own centre."""

    linear: Float[np.ndarray, "3"]
    """[m/s], camera axes."""
    angular: Float[np.ndarray, "3"]
    """[rad/s], camera axes."""
    camera: CameraTurn | None = None
    """None where the last frame came without an orientation."""

    @classmethod
    def at_rest(cls, R_ref_cam: Float[np.ndarray, "3 3"] | None = None) -> Motion:
        camera = None if R_ref_cam is None else CameraTurn(R_ref_cam)
        return cls(np.zeros(3), np.zeros(3), camera)

    @classmethod
    def between(cls, T_old: np.ndarray, T_new: np.ndarray, seconds: float) -> Motion:
        """The constant velocity that leads from one `T_cam_obj` to the next."""
        turn = Rotation.from_matrix(T_new[:3, :3] @ T_old[:3, :3].T).as_rotvec()
        return cls((T_new[:3, 3] - T_old[:3, 3]) / seconds, turn / seconds)

    def observed(
        self,
        T_old: Float[np.ndarray, "4 4"],
        T_new: Float[np.ndarray, "4 4"],
        seconds: float,
        R_ref_cam: Float[np.ndarray, "3 3"] | None,
    ) -> Motion:
        """`between` two frames, the camera's part in it told apart.

        Args:
            T_old: `T_cam_obj` of the frame that this motion ends with.
            T_new: of the frame after it, …
            seconds: … so much later, …
            R_ref_cam: … and its camera's orientation, if known.
        """
        newest = Motion.between(T_old, T_new, seconds)
        if R_ref_cam is None:
            return newest
        if self.camera is None:
            return replace(newest, camera=CameraTurn(R_ref_cam))
        still = Motion.between(T_old, self.camera.applied(T_old, R_ref_cam), seconds)
        return replace(newest, camera=CameraTurn(R_ref_cam, still.linear, still.angular))

    def turning(self, share: Float[np.ndarray, "3 3"]) -> Motion:
        """The same with this share, camera axes, of the turning that is the object's own."""
        if self.camera is None:
            return replace(self, angular=share @ self.angular)
        own = self.angular - self.camera.angular
        return replace(self, angular=self.camera.angular + share @ own)

    def stopped(self, R_ref_cam: Float[np.ndarray, "3 3"] | None) -> Motion:
        """An object at rest, from a frame on whose camera has this orientation."""
        rest = Motion.at_rest(R_ref_cam)
        if self.camera is None or rest.camera is None:
            return rest
        return replace(rest, camera=replace(rest.camera, share=self.camera.share))

    def predict(
        self,
        T_cam_obj: Float[np.ndarray, "4 4"],
        seconds: float,
        R_ref_cam: Float[np.ndarray, "3 3"] | None = None,
    ) -> Float[np.ndarray, "4 4"]:
        """Carry `T_cam_obj` forward, to a frame whose camera has this orientation, if known."""
        R_cam_obj, t_cam_obj = T_cam_obj[:3, :3], T_cam_obj[:3, 3]
        angular, t_new = self.angular, t_cam_obj + self.linear * seconds
        if self.camera is not None and R_ref_cam is not None:
            T_still = self.camera.applied(T_cam_obj, R_ref_cam)
            R_cam_obj, angular = T_still[:3, :3], angular - self.camera.angular
            beyond = T_still[:3, 3] - t_cam_obj - self.camera.linear * seconds
            t_new = t_new + self.camera.share.value * beyond
        R_turn = Rotation.from_rotvec(angular * seconds).as_matrix()
        return make_transform(R_turn @ R_cam_obj, t_new)

    def held(
        self, T_cam_obj: Float[np.ndarray, "4 4"], R_ref_cam: Float[np.ndarray, "3 3"] | None
    ) -> Float[np.ndarray, "4 4"]:
        """Where an object at rest is by now; in the same place without an orientation."""
        if self.camera is None or R_ref_cam is None:
            return T_cam_obj
        return self.stopped(self.camera.R_ref_cam).predict(T_cam_obj, 0.0, R_ref_cam)

    def blended(self, newer: Motion, weight: float) -> Motion:
        """Low-pass filter: `weight` of the newer velocity, the rest of this one."""
        camera = newer.camera
        if camera is not None and self.camera is not None:
            camera = self.camera.blended(camera, weight, newer.linear - self.linear)
        return Motion(
            (1 - weight) * self.linear + weight * newer.linear,
            (1 - weight) * self.angular + weight * newer.angular,
            camera,
        )


def seconds_between(old: float | None, new: float | None, longest: float = 10.0) -> float:
    """Time between two stamps; one period at 30 Hz where stamps are missing, out of order, or
    `longest` apart, over which no motion can be predicted."""
    if old is None or new is None or not np.isfinite([old, new]).all():
        return _NOMINAL_PERIOD
    seconds = float(new - old)
    return seconds if 0.0 < seconds < longest else _NOMINAL_PERIOD
