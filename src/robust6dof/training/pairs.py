"""Training pairs straight from the synthetic world: two views of one object, and their truth."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.spatial.transform import Rotation

from robust6dof.frames import CATEGORIES
from robust6dof.geometry.transforms import make_transform
from robust6dof.shapes.mesh import ObjectModel
from robust6dof.synthetic.close_up import TARGET_ID, CloseUp, QuickSensor, pool_object
from robust6dof.synthetic.visibility import handle_visible, visible_surface
from robust6dof.tracking.view import ViewConfig
from robust6dof.training.drawn_pairs import DrawnPairs, SeenView
from robust6dof.training.pair_batch import PairBatch
from robust6dof.training.prediction_errors import (
    ErrorConfig,
    ErrorSource,
    Replayed,
    turn_and_shift,
)

SIDES = np.round(Rotation.create_group("O").as_matrix())
"""R_obj_room of an object on each side of its box, a quarter turn after the other."""


@dataclass(frozen=True)
class PairConfig:
    """What the pairs vary."""

    step_rotation: float = np.deg2rad(7.0)
    """Scale of the rotation between the views [rad]; a fifth of the pairs move twice as much."""
    step_translation: float = 0.02
    """Standard deviation of the translation between the views, each axis [m]."""
    errors: ErrorConfig = field(default_factory=ErrorConfig)
    """Of the predictions."""
    distance: tuple[float, float] = (0.35, 1.4)
    """Of the camera from the object [m]."""
    focal_px: float = 600.0
    """Focal length of the camera in full resolution."""
    largest_px: int = 144
    """Images are rendered with at most this side."""
    occluder_share: float = 0.3
    """Share of pairs with something in front of the object."""
    lying_share: float = 0.0
    """Share of pairs in which the object lies on any side of its box instead of standing."""
    first_object: int = 0
    """Seed of the first object of each category."""
    object_pool: int = 400
    """Distinct objects in each category, with consecutive seeds."""

    @staticmethod
    def lying() -> PairConfig:
        """Of things that lie about in any way, as those of YCB-Video do."""
        return PairConfig(lying_share=0.5)


class SyntheticPairs(DrawnPairs):
    """Pairs of rendered views; see `DrawnPairs`.

    Args:
        view: what is cut out of a frame.
        prior_points: N_r.
        seed: of all pairs.
        count: length of this data set.
        config: what the pairs vary.
        categories: taken in turn.
        objects: the user's own of some categories, seen instead of procedural ones.
        replayed: a tracker's own errors, for a share of the predictions.
    """

    def __init__(
        self,
        view: ViewConfig,
        prior_points: int,
        seed: int,
        count: int,
        config: PairConfig | None = None,
        categories: Sequence[str] = CATEGORIES,
        objects: Mapping[str, Sequence[ObjectModel]] | None = None,
        replayed: Replayed | None = None,
    ) -> None:
        self.config = config or PairConfig()
        errors = ErrorSource(self.config.errors, replayed or {})
        super().__init__(view, prior_points, seed, count, categories, errors)
        self.objects = dict(objects or {})
        self.sensor = QuickSensor()

    def _draw(self, rng: np.random.Generator, category: str) -> PairBatch | None:
        target = self._object(rng, category)
        T_prev = _draw_view(rng, self.config)
        R_obj_room = None
        if self.config.lying_share and rng.random() < self.config.lying_share:
            R_obj_room = SIDES[int(rng.integers(len(SIDES)))]
            T_prev = T_prev @ make_transform(R_obj_room.T, np.zeros(3))
        T_cur = _move(rng, T_prev, self.config)
        close_up = CloseUp.draw(rng, target, R_obj_room)
        if rng.random() < self.config.occluder_share:
            close_up = close_up.with_occluder(rng, T_prev)
        errors = self.errors.draw(rng, category)
        extents_pred = target.extents * errors.stretch
        window = _window(T_prev, target, self.config)
        seen = [
            self._render(rng, close_up, window, T_cam_obj, T_prev, predict, extents_pred)
            for T_cam_obj, predict in ((T_prev, errors.previous), (T_cur, errors.current))
        ]
        if seen[0] is None or seen[1] is None:
            return None
        return self._assemble(rng, category, target.scale, seen[0], seen[1])

    def _object(self, rng: np.random.Generator, category: str) -> ObjectModel:
        own = self.objects.get(category)
        if own:
            return own[int(rng.integers(len(own)))]
        return pool_object(
            category, self.config.first_object + int(rng.integers(self.config.object_pool))
        )

    def _render(
        self,
        rng: np.random.Generator,
        close_up: CloseUp,
        window: tuple[np.ndarray, int],
        T_cam_obj: np.ndarray,
        T_cam_last: np.ndarray,
        predict: Callable[[np.random.Generator, np.ndarray], np.ndarray],
        extents_pred: np.ndarray,
    ) -> SeenView | None:
        """One view, predicted from a disturbed last pose; None where too little is seen."""
        K, size = window
        rendering = close_up.render(T_cam_obj, K, size)
        frame = self.sensor.observe(rendering, K, rng)
        T_cam_pred = predict(rng, T_cam_last)
        mask = rendering.ids == TARGET_ID
        seen = self._see(rng, frame, mask, T_cam_obj, T_cam_pred, extents_pred)
        if seen is None:
            return None
        surface = visible_surface(rendering, TARGET_ID, K, T_cam_obj)
        return replace(seen, handle_visible=handle_visible(surface, close_up.target.extents))


def _draw_view(rng: np.random.Generator, config: PairConfig) -> np.ndarray:
    """T_cam_obj of a camera above the table that looks near the object."""
    elevation = np.deg2rad(rng.uniform(12, 90))
    R_cam_obj = (
        Rotation.from_euler("z", rng.uniform(0, 2 * np.pi) if rng.random() < 0.7 else 0.0)
        * Rotation.from_euler("x", elevation + np.pi)
        * Rotation.from_euler("y", rng.uniform(0, 2 * np.pi))
    )
    distance = float(np.exp(rng.uniform(*np.log(config.distance))))
    return make_transform(R_cam_obj.as_matrix(), np.array([0.0, 0.0, distance]))


def _move(rng: np.random.Generator, T_cam_obj: np.ndarray, config: PairConfig) -> np.ndarray:
    factor = 2.0 if rng.random() < 0.2 else 1.0
    return turn_and_shift(
        rng, T_cam_obj, factor * config.step_rotation, factor * config.step_translation
    )


def _window(
    T_cam_obj: np.ndarray, target: ObjectModel, config: PairConfig
) -> tuple[np.ndarray, int]:
    """Intrinsics of a square image about the object, reduced where the object is near."""
    distance = float(T_cam_obj[2, 3])
    side = config.focal_px * 1.9 * target.scale / distance
    size = int(np.clip(side, 48, config.largest_px))
    focal = config.focal_px * size / side
    centre = (size - 1) / 2
    return np.array([[focal, 0, centre], [0, focal, centre], [0, 0, 1.0]]), size
