"""Good frames of an object on a table, and every way to spoil them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from baselines.tabletop_scene import Tabletop, look_at_object, make_tabletop
from robust6dof.frames import RgbdFrame

VIEWS = 8
PERIOD_S = 1 / 30


@dataclass(frozen=True)
class Flight:
    """A camera that sways before an object: its frames at half the size, made once."""

    category: str
    seed: int

    @cached_property
    def scene(self) -> Tabletop:
        return make_tabletop(self.category, self.seed)

    @cached_property
    def _shots(self) -> list[tuple[RgbdFrame, np.ndarray]]:
        return [self._shoot(self.scene, view) for view in range(VIEWS)]

    @cached_property
    def _away(self) -> list[RgbdFrame]:
        aims = [[2.0, 0.3, -1.7], [-1.9, 0.2, 1.5]]
        return [self._shoot(self.scene, view, aim)[0] for view, aim in enumerate(aims)]

    @cached_property
    def _bare(self) -> list[RgbdFrame]:
        scene = replace(self.scene, with_object=False)
        return [self._shoot(scene, view)[0] for view in (0, 4)]

    def good(self, index: int) -> RgbdFrame:
        """To and fro."""
        turn = index % (2 * VIEWS - 2)
        return self._shots[min(turn, 2 * VIEWS - 2 - turn)][0]

    def away(self, index: int) -> RgbdFrame:
        """Nothing of the object in view."""
        return self._away[index % len(self._away)]

    def bare(self, index: int) -> RgbdFrame:
        """The object taken away."""
        return self._bare[index % len(self._bare)]

    @property
    def first_T_cam_obj(self) -> np.ndarray:
        return self._shots[0][1]

    def _shoot(
        self, scene: Tabletop, view: int, aim: list[float] | None = None
    ) -> tuple[RgbdFrame, np.ndarray]:
        T_cam_world = look_at_object(
            0.7 + 0.012 * view, 0.7, 0.75, [0.01 * np.sin(view), 0, 0.01] if aim is None else aim
        )
        shot = scene.shoot(T_cam_world, np.random.default_rng(view))
        K = shot.frame.K * [[0.5], [0.5], [1.0]]
        return RgbdFrame(shot.frame.rgb[::2, ::2], shot.frame.depth[::2, ::2], K), shot.T_cam_obj


def _with_depth(value: float) -> Callable[[RgbdFrame, np.random.Generator], RgbdFrame]:
    return lambda frame, rng: replace(frame, depth=np.full_like(frame.depth, value))


def _holes(value: float) -> Callable[[RgbdFrame, np.random.Generator], RgbdFrame]:
    def spoil(frame: RgbdFrame, rng: np.random.Generator) -> RgbdFrame:
        holes = rng.random(frame.depth.shape) < rng.uniform(0.05, 0.9)
        return replace(frame, depth=np.where(holes, np.float32(value), frame.depth))

    return spoil


def _negative(frame: RgbdFrame, rng: np.random.Generator) -> RgbdFrame:
    return replace(frame, depth=-frame.depth)


def _one_pixel(frame: RgbdFrame, rng: np.random.Generator) -> RgbdFrame:
    depth = np.zeros_like(frame.depth)
    depth[rng.integers(frame.height), rng.integers(frame.width)] = rng.uniform(0.1, 2.0)
    return replace(frame, depth=depth)


def _noise(frame: RgbdFrame, rng: np.random.Generator) -> RgbdFrame:
    rgb = rng.integers(0, 256, frame.rgb.shape).astype(np.uint8)
    return replace(frame, depth=rng.uniform(-1, 3, frame.depth.shape).astype(np.float32), rgb=rgb)


def _wall(frame: RgbdFrame, rng: np.random.Generator) -> RgbdFrame:
    return replace(frame, depth=np.full_like(frame.depth, rng.uniform(0.02, 0.5)))


def _filled(frame: RgbdFrame, rng: np.random.Generator) -> RgbdFrame:
    """The middle of the image, as from so much nearer."""
    size, nearer = (frame.width, frame.height), rng.uniform(3, 8)
    K = cv2.getRotationMatrix2D((frame.width / 2, frame.height / 2), 0, nearer)
    rgb = cv2.warpAffine(frame.rgb, K, size)
    depth = cv2.warpAffine(frame.depth, K, size, flags=cv2.INTER_NEAREST)
    return replace(frame, rgb=rgb, depth=(depth / nearer).astype(np.float32))


def _with_color(level: int) -> Callable[[RgbdFrame, np.random.Generator], RgbdFrame]:
    return lambda frame, rng: replace(frame, rgb=np.full_like(frame.rgb, level))


def _colorless(frame: RgbdFrame, rng: np.random.Generator) -> RgbdFrame:
    return replace(frame, rgb=np.zeros_like(frame.rgb), has_color=False)


def _spun(frame: RgbdFrame, rng: np.random.Generator) -> RgbdFrame:
    """A gyro gone mad."""
    return replace(frame, R_ref_cam=Rotation.random(rng=rng).as_matrix())


def _dark(frame: RgbdFrame, rng: np.random.Generator) -> RgbdFrame:
    return replace(frame, rgb=np.zeros_like(frame.rgb), depth=np.zeros_like(frame.depth))


BLIND: dict[str, Callable[[RgbdFrame, np.random.Generator], RgbdFrame]] = {
    "no depth": _with_depth(0.0),
    "all NaN": _with_depth(np.nan),
    "all infinite": _with_depth(np.inf),
    "negative": _negative,
    "far away": _with_depth(1e6),
    "one pixel": _one_pixel,
    "dark": _dark,
}
"""Frames whose depth shows nothing of the object."""
SPOILED: dict[str, Callable[[RgbdFrame, np.random.Generator], RgbdFrame]] = {
    "holes": _holes(0.0),
    "NaN holes": _holes(np.nan),
    "infinite holes": _holes(np.inf),
    "noise": _noise,
    "wall": _wall,
    "filled": _filled,
    "black": _with_color(0),
    "saturated": _with_color(255),
    "colourless": _colorless,
    "spun": _spun,
}
CLOCKS: dict[str, Callable[[float, np.random.Generator], float | None]] = {
    "runs": lambda last, rng: last + PERIOD_S,
    "stands still": lambda last, rng: last,
    "goes back": lambda last, rng: last - rng.uniform(0.01, 3.0),
    "jumps": lambda last, rng: last + rng.choice([0.2, 0.5, 3.0, 60.0, 1e9]),
    "is not there": lambda last, rng: None,
    "is not a number": lambda last, rng: rng.choice([np.nan, np.inf, -np.inf]),
}
