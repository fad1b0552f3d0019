"""Where the canonical frame lies on the tracked surface: what many views' anchors agree on.

Registration follows the surface to a fraction of a degree, but knows the object's frame only from
the first pose; the anchor knows the frame from every single view, each time a few degrees off. So
the frame is estimated on the surface: repeated looks from one side err together and are averaged
into one opinion, and the opinions of different sides, and of the start, are joined robustly.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from robust6dof.geometry.transforms import invert_transform, make_transform, view_direction

_ITERATIONS = 3
"""Of each frame; the next one goes on from there."""


@dataclass(frozen=True)
class Doubt:
    """Standard deviations of a pose and scale; zeros are certain."""

    rotation: float
    """[rad]"""
    translation: float
    """Of the centre [m]."""
    scale: float
    """Of the scale's logarithm."""


ROUGH_START = Doubt(np.deg2rad(5.0), 0.03, 0.12)
"""A start as category-level detectors give it (the "Pert." noise of the field's protocols)."""

ESTIMATED_START = Doubt(np.deg2rad(12.0), 0.02, 0.15)
"""A start that was fitted to the first frame's depth."""

EXACT_START = Doubt(0.0, 0.0, 0.0)
"""A start that is true, as some protocols give it."""


@dataclass(frozen=True)
class CanonicalFrameConfig:
    """What an opinion counts."""

    view_rotation: float = np.deg2rad(4.0)
    """Standard deviation of what the looks from one side agree on [rad], …"""
    view_translation_share: float = 0.05
    """… of its centre, in box diagonals, …"""
    view_scale: float = 0.06
    """… and of the logarithm of its scale."""
    side_angle: float = np.deg2rad(15.0)
    """Views whose directions differ by less are one side [rad]."""
    looks: int = 15
    """A side's opinion is a running mean over so many looks."""
    first_looks: int = 3
    """The first look is the best of several and counts as so many."""
    few_looks: float = 1.5
    """A side with as many looks counts half."""
    slip_rotation: float = np.deg2rad(0.2)
    """By how much old opinions lose certainty: the surface may slip on the object [rad/s], …"""
    slip_translation: float = 0.001
    """… [m/s]"""
    first_scale: float = 3.0
    """A first look whose size is more standard deviations off the start's is not begun from: it
    took in what stands beside the object, or nothing like it was ever seen."""
    robust: float = 2.0
    """A side's opinion that is as many standard deviations off counts a quarter."""


@dataclass(frozen=True, eq=False)
class Opinion:
    """One side's running mean."""

    T_model_obj: Float[np.ndarray, "4 4"]
    scale: float
    """Box diagonal [m]."""
    direction: Float[np.ndarray, "3"]
    """To the camera, in the model frame; zero for the start's opinion."""
    seconds: float
    """When it was last renewed."""
    looks: int = 1


@dataclass(frozen=True, eq=False)
class CanonicalFrame:
    """The estimate and the opinions behind it. Immutable."""

    T_model_obj: Float[np.ndarray, "4 4"]
    scale: float
    """Box diagonal [m]."""
    start: Opinion
    doubt: Doubt
    sides: tuple[Opinion, ...] = ()
    config: CanonicalFrameConfig = field(default_factory=CanonicalFrameConfig)
    rotation_doubt: float = 0.0
    """Standard deviation of the estimate's rotation [rad], the opinions' quarrel counted in."""

    @classmethod
    def at_start(
        cls, scale: float, doubt: Doubt, config: CanonicalFrameConfig | None = None
    ) -> CanonicalFrame:
        """The model frame is the given object frame, until the views say otherwise."""
        start = Opinion(np.eye(4), scale, np.zeros(3), 0.0)
        config = config or CanonicalFrameConfig()
        return cls(np.eye(4), scale, start, doubt, (), config, doubt.rotation)

    def with_look(
        self,
        T_cam_model: Float[np.ndarray, "4 4"],
        T_cam_obj: Float[np.ndarray, "4 4"],
        scale: float,
        *,
        symmetric: bool,
        seconds: float,
    ) -> CanonicalFrame:
        """With one view's anchor.

        Args:
            T_cam_model: the tracked surface in this view.
            T_cam_obj: the anchor's pose.
            scale: the anchor's box diagonal [m].
            symmetric: only the anchor's axis is meant; its turn about y is left out.
            seconds: time since the start.
        """
        T_model_cam = invert_transform(T_cam_model)
        T_seen = T_model_cam @ T_cam_obj
        if symmetric:
            T_seen = make_transform(
                _with_axis(self.T_model_obj[:3, :3], T_seen[:3, 1]), T_seen[:3, 3]
            )
        looks = 1 if self.sides else self.config.first_looks
        look = Opinion(T_seen, scale, view_direction(T_cam_model), seconds, looks)
        frame = replace(self, sides=self._sides_with(look))
        if not self.sides and self._sized_like_start(scale):
            # A start far from the first look is wrong more often than the look: begin from there.
            frame = replace(frame, T_model_obj=T_seen, scale=scale)
        return frame._solved(seconds)

    def _sized_like_start(self, scale: float) -> bool:
        off = abs(float(np.log(scale / self.start.scale)))
        return off < self.config.first_scale * self.doubt.scale

    @property
    def certain(self) -> bool:
        """Whether the start is beyond doubt."""
        return self.doubt == EXACT_START

    def rebased(self) -> CanonicalFrame:
        """The same, the model frame moved to where the object's is now."""
        T_new_old = invert_transform(self.T_model_obj)
        R_new_old = T_new_old[:3, :3]

        def moved(opinion: Opinion) -> Opinion:
            return replace(
                opinion,
                T_model_obj=T_new_old @ opinion.T_model_obj,
                direction=R_new_old @ opinion.direction,
            )

        sides = tuple(moved(side) for side in self.sides)
        return replace(self, T_model_obj=np.eye(4), start=moved(self.start), sides=sides)

    def _sides_with(self, look: Opinion) -> tuple[Opinion, ...]:
        cosines = [float(side.direction @ look.direction) for side in self.sides]
        nearest = int(np.argmax(cosines)) if cosines else -1
        if nearest < 0 or cosines[nearest] < np.cos(self.config.side_angle):
            return (*self.sides, look)
        merged = _merged(self.sides[nearest], look, self.config.looks)
        return (*self.sides[:nearest], merged, *self.sides[nearest + 1 :])

    def _solved(self, seconds: float) -> CanonicalFrame:
        """Weighted means on the tangent of the estimate, weights renewed (Geman-McClure)."""
        opinions = [self.start, *self.sides]
        certainty = [self._precision(opinion, seconds) for opinion in opinions]
        T, log_scale = self.T_model_obj, float(np.log(self.scale))
        turns = Rotation.from_matrix([o.T_model_obj[:3, :3] for o in opinions])
        centres = np.array([o.T_model_obj[:3, 3] for o in opinions])
        log_scales = np.log([o.scale for o in opinions])
        p_turn, p_centre, p_scale = np.array(certainty).T
        for _ in range(_ITERATIONS):
            R = Rotation.from_matrix(T[:3, :3])
            away = (R.inv() * turns).as_rotvec()
            step = self._mean(away, p_turn)
            centre = T[:3, 3] + self._mean(centres - T[:3, 3], p_centre)
            T = make_transform((R * Rotation.from_rotvec(step)).as_matrix(), centre)
            log_scale += float(self._mean((log_scales - log_scale)[:, None], p_scale)[0])
        away = (Rotation.from_matrix(T[:3, :3]).inv() * turns).as_rotvec()
        return replace(
            self,
            T_model_obj=T,
            scale=float(np.exp(log_scale)),
            rotation_doubt=self._deviation(away, p_turn),
        )

    def _precision(self, opinion: Opinion, seconds: float) -> tuple[float, float, float]:
        """Inverse variances of rotation, centre and log-scale."""
        config, doubt = self.config, self.doubt
        if opinion is self.start:
            share, base = 1.0, (doubt.rotation, doubt.translation, doubt.scale)
        else:
            share = opinion.looks / (opinion.looks + config.few_looks)
            shift = config.view_translation_share * opinion.scale
            base = (config.view_rotation, shift, config.view_scale)
        age = max(seconds - opinion.seconds, 0.0)
        lost = (age * config.slip_rotation, age * config.slip_translation, 0.0)
        rotation, translation, scale = (
            share / (s**2 + extra**2 + 1e-12) for s, extra in zip(base, lost, strict=True)
        )
        return rotation, translation, scale

    def _mean(
        self, away: Float[np.ndarray, "O D"], precision: Float[np.ndarray, "O"]
    ) -> Float[np.ndarray, "D"]:
        weight = self._weight(away, precision)
        return weight @ away / weight.sum()

    def _deviation(
        self, away: Float[np.ndarray, "O D"], precision: Float[np.ndarray, "O"]
    ) -> float:
        """Standard deviation of the mean: what the opinions claim, or more where they quarrel."""
        weight = self._weight(away, precision)
        claimed = 1.0 / weight.sum()
        quarrel = float(weight @ (away**2).sum(-1)) / weight.sum() / len(weight)
        return float(np.sqrt(claimed + quarrel))

    def _weight(
        self, away: Float[np.ndarray, "O D"], precision: Float[np.ndarray, "O"]
    ) -> Float[np.ndarray, "O"]:
        squared = (away**2).sum(-1) * precision / self.config.robust**2
        if self.certain:
            squared[0] = 0.0
        return precision / (1.0 + squared) ** 2


def _merged(old: Opinion, new: Opinion, looks: int) -> Opinion:
    """Running mean over the last looks; the side keeps its direction."""
    share = 1.0 / min(old.looks + 1, looks)
    R_old = Rotation.from_matrix(old.T_model_obj[:3, :3])
    turn = (R_old.inv() * Rotation.from_matrix(new.T_model_obj[:3, :3])).as_rotvec()
    R = (R_old * Rotation.from_rotvec(share * turn)).as_matrix()
    centre = (1 - share) * old.T_model_obj[:3, 3] + share * new.T_model_obj[:3, 3]
    scale = old.scale ** (1 - share) * new.scale**share
    return Opinion(make_transform(R, centre), scale, old.direction, new.seconds, old.looks + 1)


def _with_axis(
    R: Float[np.ndarray, "3 3"], axis: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "3 3"]:
    """R turned by the least angle that brings its y axis to `axis`."""
    turn = Rotation.align_vectors(axis[None], R[:, 1][None])[0]
    return turn.as_matrix() @ R
