"""Textures of the room's surfaces: wood, laminate, cloth, tiles, carpet."""

from __future__ import annotations

from collections.abc import Callable

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from robust6dof.shapes.textures import any_pattern

_SIZE = 256

_Texture = UInt8[np.ndarray, "Th Tw 3"]


def table_texture(rng: np.random.Generator) -> _Texture:
    """A table top, drawn; it repeats without a seam."""
    kinds: list[Callable[[np.random.Generator], _Texture]] = [wood_texture, _laminate, _cloth]
    return kinds[int(rng.integers(len(kinds)))](rng)


def floor_texture(rng: np.random.Generator) -> _Texture:
    """A floor, drawn; it repeats without a seam."""
    kinds: list[Callable[[np.random.Generator], _Texture]] = [_tiles, carpet_texture, wood_texture]
    return kinds[int(rng.integers(len(kinds)))](rng)


def wall_texture(rng: np.random.Generator) -> _Texture:
    """A painted wall."""
    color = rng.uniform(170, 235) + rng.uniform(-12, 12, 3)
    return _tinted(0.97 + 0.03 * _noise(rng, 4), color)


def wood_texture(rng: np.random.Generator) -> _Texture:
    """Planed wood; its grain runs along the texture's rows."""
    color = np.array([150.0, 105.0, 65.0]) * rng.uniform(0.6, 1.5) + rng.uniform(-15, 15, 3)
    across = np.linspace(0.0, 2.0 * np.pi, _SIZE, endpoint=False)
    warp = 2.5 * _noise(rng, 8, stretch=8)
    grain = 0.5 + 0.5 * np.sin(across[:, None] * rng.integers(5, 12) + 2.0 * np.pi * warp)
    return _tinted(0.75 + 0.2 * grain + 0.1 * _noise(rng, 2, stretch=16), color)


def _laminate(rng: np.random.Generator) -> _Texture:
    color = rng.uniform(90, 230) + rng.uniform(-20, 20, 3)
    return _tinted(0.94 + 0.06 * _noise(rng, 1), color)


def _cloth(rng: np.random.Generator) -> _Texture:
    color = rng.uniform(80, 220, 3)
    stripes = np.arange(_SIZE) // int(rng.choice([16, 32, 64])) % 2
    weave = 0.5 * (stripes[:, None] + stripes[None, :])
    return _tinted(0.7 + 0.25 * weave + 0.08 * _noise(rng, 1), color)


def _tiles(rng: np.random.Generator) -> _Texture:
    color = rng.uniform(110, 200) + rng.uniform(-15, 15, 3)
    place = np.arange(_SIZE) % (_SIZE // 4)
    joint = (place[:, None] < 3) | (place[None, :] < 3)
    shade = np.repeat(np.repeat(rng.uniform(0.85, 1.0, (4, 4)), _SIZE // 4, 0), _SIZE // 4, 1)
    return _tinted(np.where(joint, 0.6, shade) + 0.04 * _noise(rng, 1), color)


def picture_texture(rng: np.random.Generator) -> _Texture:
    """A picture on a wall: one of the patterns that objects wear."""
    return any_pattern(rng, _SIZE, _SIZE)


def carpet_texture(rng: np.random.Generator) -> _Texture:
    """A carpet of one colour."""
    return _tinted(0.65 + 0.35 * _noise(rng, 2), rng.uniform(60, 160, 3))


def _noise(rng: np.random.Generator, coarse: int, stretch: int = 1) -> Float[np.ndarray, "Th Tw"]:
    """Smooth noise in [0, 1] that wraps around; `coarse` is its grain in pixels."""
    noise = rng.uniform(0.0, 1.0, (_SIZE, _SIZE))
    kernel = (2 * coarse * stretch + 1, 2 * coarse + 1)
    wrapped = np.pad(noise, ((kernel[1],) * 2, (kernel[0],) * 2), mode="wrap")
    smooth = cv2.blur(wrapped, kernel)[kernel[1] : -kernel[1], kernel[0] : -kernel[0]]
    low, high = smooth.min(), smooth.max()
    return (smooth - low) / (high - low)


def _tinted(level: Float[np.ndarray, "Th Tw"], color: Float[np.ndarray, "3"]) -> _Texture:
    return np.clip(level[..., None] * color, 0, 255).astype(np.uint8)
