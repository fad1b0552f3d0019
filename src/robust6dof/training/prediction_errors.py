"""How far the predictions of training pairs are off: drawn at random, or as a tracker's were."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from robust6dof.geometry.transforms import invert_transform, make_transform, rotation_about_y


@dataclass(frozen=True)
class ErrorConfig:
    """Prediction errors at least as large as the aerial motion."""

    rotation: float = np.deg2rad(6.0)
    """Scale of the rotation error [rad], before `factors`."""
    translation: float = 0.015
    """Standard deviation of the translation error, each axis [m], likewise."""
    scale: float = 0.08
    """Standard deviation of the log of the scale error, likewise."""
    factors: tuple[float, ...] = (0.4, 0.4, 1.0, 1.0, 2.5)
    """One of these, drawn for each pair, multiplies its errors: a track that holds, one that slips,
    a start from a rough pose."""
    shape: float = 0.05
    """Standard deviation of the log of each side's error."""
    replay_share: float = 0.5
    """Share of the pairs whose errors are replayed, where a tracker's own are given."""


@dataclass(frozen=True, eq=False)
class PoseError:
    """How an estimated pose differs from the true one."""

    R_true_est: Float[np.ndarray, "3 3"]
    """Turn in the true object's own axes, so that an error of yaw stays one."""
    shift_cam: Float[np.ndarray, "3"]
    """In the camera's axes [m], so that an error of depth stays one."""
    stretch: Float[np.ndarray, "3"]
    """Estimated sides over the true ones."""

    @staticmethod
    def between(
        T_cam_true: Float[np.ndarray, "4 4"],
        T_cam_est: Float[np.ndarray, "4 4"],
        stretch: Float[np.ndarray, "3"],
        symmetric: bool = False,
    ) -> PoseError:
        """The error of an estimate; a symmetric object's without the turn about its y axis."""
        R = (invert_transform(T_cam_true) @ T_cam_est)[:3, :3]
        if symmetric:
            R = rotation_about_y(np.arctan2(R[0, 2] - R[2, 0], R[0, 0] + R[2, 2])).T @ R
        return PoseError(R, T_cam_est[:3, 3] - T_cam_true[:3, 3], stretch)

    def applied(self, T_cam_obj: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "4 4"]:
        """A pose that is off by this."""
        return make_transform(
            T_cam_obj[:3, :3] @ self.R_true_est, T_cam_obj[:3, 3] + self.shift_cam
        )


Replayed = Mapping[str, Sequence[tuple[PoseError, PoseError]]]
"""Category → a tracker's errors in two frames, one after the other."""


@dataclass(frozen=True, eq=False)
class PairErrors:
    """The errors of one pair's predictions."""

    stretch: Float[np.ndarray, "3"]
    """Predicted sides over the true ones; the same in both views."""
    rotation: float = 0.0
    """Scale of what is drawn for each view [rad]."""
    translation: float = 0.0
    """Likewise, each axis [m]."""
    replayed: tuple[PoseError, PoseError] | None = None
    """Of the previous and of the current view, instead of what would be drawn."""

    def previous(
        self, rng: np.random.Generator, T_cam_obj: Float[np.ndarray, "4 4"]
    ) -> Float[np.ndarray, "4 4"]:
        """The prediction that the previous view is looked at with, about the true last pose."""
        return self._applied(rng, T_cam_obj, 0)

    def current(
        self, rng: np.random.Generator, T_cam_obj: Float[np.ndarray, "4 4"]
    ) -> Float[np.ndarray, "4 4"]:
        """The prediction for the current view, about the same pose."""
        return self._applied(rng, T_cam_obj, 1)

    def _applied(self, rng: np.random.Generator, T_cam_obj: np.ndarray, view: int) -> np.ndarray:
        if self.replayed is not None:
            return self.replayed[view].applied(T_cam_obj)
        return turn_and_shift(rng, T_cam_obj, self.rotation, self.translation)


@dataclass(frozen=True, eq=False)
class ErrorSource:
    """Where the errors of pairs come from."""

    config: ErrorConfig
    replayed: Replayed

    def draw(self, rng: np.random.Generator, category: str) -> PairErrors:
        """Those of one pair."""
        own = self.replayed.get(category)
        if own and rng.random() < self.config.replay_share:
            errors = own[int(rng.integers(len(own)))]
            return PairErrors(errors[0].stretch, replayed=errors)
        factor = float(rng.choice(self.config.factors))
        common = rng.normal(0, factor * self.config.scale)
        stretch = np.exp(common + rng.normal(0, self.config.shape, 3))
        return PairErrors(stretch, factor * self.config.rotation, factor * self.config.translation)


def turn_and_shift(
    rng: np.random.Generator, T_cam_obj: Float[np.ndarray, "4 4"], angle: float, shift: float
) -> Float[np.ndarray, "4 4"]:
    """Turn about the object's own origin by |N(0, angle)|, and shift in the camera frame."""
    axis = rng.normal(size=3)
    turn = Rotation.from_rotvec(axis / np.linalg.norm(axis) * rng.normal(0, angle)).as_matrix()
    return make_transform(turn @ T_cam_obj[:3, :3], T_cam_obj[:3, 3] + rng.normal(0, shift, 3))
