"""Training pairs straight from the synthetic world: two views of one object, and their truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields

import numpy as np
import torch
from jaxtyping import Bool, Float
from scipy.spatial.transform import Rotation
from torch import Tensor
from torch.utils.data import Dataset

from robust6dof.frames import CATEGORIES, SYMMETRIC_CATEGORIES
from robust6dof.geometry.transforms import make_transform
from robust6dof.network.inputs import ViewBatch
from robust6dof.shapes.mesh import ObjectModel
from robust6dof.shapes.priors import load_prior
from robust6dof.synthetic.close_up import TARGET_ID, CloseUp, QuickSensor, pool_object
from robust6dof.synthetic.visibility import handle_visible, visible_surface
from robust6dof.tracking.view import View, ViewConfig, make_view
from robust6dof.training.targets import PairTruth

SIDES = np.round(Rotation.create_group("O").as_matrix())
"""R_obj_room of an object on each side of its box, a quarter turn after the other."""
HANDLED = frozenset({"mug", "025_mug"})
"""Symmetric while their handle hides."""


@dataclass(frozen=True)
class PairConfig:
    """What the pairs vary. Prediction errors are at least as large as the aerial motion."""

    step_rotation: float = np.deg2rad(7.0)
    """Scale of the rotation between the views [rad]; a fifth of the pairs move twice as much."""
    step_translation: float = 0.02
    """Standard deviation of the translation between the views, each axis [m]."""
    error_rotation: float = np.deg2rad(6.0)
    """Scale of the prediction's rotation error [rad], before `error_factors`."""
    error_translation: float = 0.015
    """Standard deviation of its translation error, each axis [m], likewise."""
    error_scale: float = 0.08
    """Standard deviation of the log of its scale error, likewise."""
    error_factors: tuple[float, ...] = (0.4, 0.4, 1.0, 1.0, 2.5)
    """One of these, drawn for each pair, multiplies its errors: a track that holds, one that slips,
    a start from a rough pose."""
    error_shape: float = 0.05
    """Standard deviation of the log of each side's error."""
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


@dataclass(frozen=True, eq=False)
class PairBatch:
    """B training pairs."""

    previous: ViewBatch
    current: ViewBatch
    prior: Float[Tensor, "B Nr 3"]
    truth: PairTruth

    def to(self, device: torch.device | str) -> PairBatch:
        """The same on another device."""
        return PairBatch(
            self.previous.to(device),
            self.current.to(device),
            self.prior.to(device),
            self.truth.to(device),
        )


@dataclass(frozen=True, eq=False)
class _Seen:
    """One view and what is true of it."""

    view: View
    T_cam_obj: Float[np.ndarray, "4 4"]
    on_object: Bool[np.ndarray, "N"]
    handle_visible: bool


class SyntheticPairs(Dataset[PairBatch]):
    """Pair i is drawn from the seed (seed, i) alone: any worker, any order, the same pair.

    `objects` are the user's own of some categories, seen instead of procedural ones.
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
    ) -> None:
        self.view = view
        self.prior_points = prior_points
        self.seed = seed
        self.count = count
        self.config = config or PairConfig()
        self.categories = tuple(categories)
        self.objects = dict(objects or {})
        self.sensor = QuickSensor()
        self.priors = {name: load_prior(name) for name in self.categories}

    def __len__(self) -> int:
        return self.count

    def __getitem__(self, index: int) -> PairBatch:
        """Pair `index` as a batch of one; draws again, from the same stream, if nothing is seen."""
        rng = np.random.default_rng([self.seed, index])
        while True:
            pair = self._draw(rng, self.categories[index % len(self.categories)])
            if pair is not None:
                return pair

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
        factor = float(rng.choice(self.config.error_factors))
        extents_pred = _disturb_extents(rng, target.extents, self.config, factor)
        seen_prev = self._see(rng, close_up, T_prev, extents_pred, T_prev, factor)
        seen_cur = self._see(rng, close_up, T_cur, extents_pred, T_prev, factor)
        if seen_prev is None or seen_cur is None:
            return None
        return self._assemble(rng, target, seen_prev, seen_cur)

    def _object(self, rng: np.random.Generator, category: str) -> ObjectModel:
        own = self.objects.get(category)
        if own:
            return own[int(rng.integers(len(own)))]
        return pool_object(
            category, self.config.first_object + int(rng.integers(self.config.object_pool))
        )

    def _see(
        self,
        rng: np.random.Generator,
        close_up: CloseUp,
        T_cam_obj: np.ndarray,
        extents_pred: np.ndarray,
        T_cam_last: np.ndarray,
        factor: float,
    ) -> _Seen | None:
        """One view, predicted from a disturbed last pose; None where too little is seen."""
        config = self.config
        K, size = _window(T_cam_last, close_up.target, config)
        rendering = close_up.render(T_cam_obj, K, size)
        frame = self.sensor.observe(rendering, K, rng)
        T_cam_pred = _turn_and_shift(
            rng, T_cam_last, factor * config.error_rotation, factor * config.error_translation
        )
        view = make_view(frame, T_cam_pred, extents_pred, self.view, rng)
        if view is None:
            return None
        x, y = view.frame_pixels.astype(int).T
        on_object = rendering.ids[y, x] == TARGET_ID
        if on_object.mean() < 0.1:
            return None
        surface = visible_surface(rendering, TARGET_ID, K, T_cam_obj)
        return _Seen(view, T_cam_obj, on_object, handle_visible(surface, close_up.target.extents))

    def _assemble(
        self, rng: np.random.Generator, target: ObjectModel, previous: _Seen, current: _Seen
    ) -> PairBatch:
        prior = self.priors[target.category]
        chosen = rng.choice(len(prior), self.prior_points, replace=len(prior) < self.prior_points)
        handle_seen = previous.handle_visible or current.handle_visible
        symmetric = target.category in SYMMETRIC_CATEGORIES or (
            target.category in HANDLED and not handle_seen
        )
        truth = PairTruth(
            T_cam_obj_prev=batch_of_one(previous.T_cam_obj),
            T_cam_obj_cur=batch_of_one(current.T_cam_obj),
            scale=batch_of_one(np.array(target.scale)),
            symmetric=torch.tensor([symmetric]),
            on_object_prev=torch.from_numpy(previous.on_object)[None],
            on_object_cur=torch.from_numpy(current.on_object)[None],
        )
        return PairBatch(
            previous.view.batch, current.view.batch, batch_of_one(prior[chosen]), truth
        )


def collate(pairs: Sequence[PairBatch]) -> PairBatch:
    """Several pairs as one batch."""
    truths = [pair.truth for pair in pairs]
    truth = {f.name: torch.cat([getattr(t, f.name) for t in truths]) for f in fields(PairTruth)}
    return PairBatch(
        ViewBatch.cat([pair.previous for pair in pairs]),
        ViewBatch.cat([pair.current for pair in pairs]),
        torch.cat([pair.prior for pair in pairs]),
        PairTruth(**truth),
    )


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
    return _turn_and_shift(
        rng, T_cam_obj, factor * config.step_rotation, factor * config.step_translation
    )


def _turn_and_shift(
    rng: np.random.Generator, T_cam_obj: np.ndarray, angle: float, shift: float
) -> np.ndarray:
    """Turn about the object's own origin by |N(0, angle)|, and shift in the camera frame."""
    axis = rng.normal(size=3)
    turn = Rotation.from_rotvec(axis / np.linalg.norm(axis) * rng.normal(0, angle)).as_matrix()
    return make_transform(turn @ T_cam_obj[:3, :3], T_cam_obj[:3, 3] + rng.normal(0, shift, 3))


def _disturb_extents(
    rng: np.random.Generator, extents: np.ndarray, config: PairConfig, factor: float
) -> np.ndarray:
    common = rng.normal(0, factor * config.error_scale)
    return extents * np.exp(common + rng.normal(0, config.error_shape, 3))


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


def batch_of_one(values: np.ndarray) -> Tensor:
    """As float32 with a leading axis of one."""
    return torch.from_numpy(np.asarray(values, dtype=np.float32))[None]
