"""Random surface images: colours, gradients, stripes, noise, speckle, checks."""

from __future__ import annotations

import colorsys
from collections.abc import Callable
from typing import SupportsInt

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from robust6dof.shapes.draw import Draw
from robust6dof.shapes.mesh import Material

Image = UInt8[np.ndarray, "H W 3"]
Color = UInt8[np.ndarray, "3"]


def random_color(rng: np.random.Generator) -> Color:
    """A colour as household goods have: a third white, grey or black, the rest of any hue."""
    if rng.random() < 0.35:
        return np.full(
            3, (rng.integers(5, 60), rng.integers(60, 200), 240)[rng.integers(3)], np.uint8
        )
    hue, saturation, value = rng.random(), rng.uniform(0.25, 1.0), rng.uniform(0.2, 1.0)
    return _rgb(hue, saturation, value)


def near(color: Color, rng: np.random.Generator, spread: float = 40.0) -> Color:
    """A colour not far from another."""
    return np.clip(color + rng.normal(0, spread, 3), 0, 255).astype(np.uint8)


def metal(rng: np.random.Generator) -> Color:
    """Bare metal: grey, slightly warm or cold, sometimes brass or copper."""
    if rng.random() < 0.15:
        return _rgb(rng.uniform(0.05, 0.13), rng.uniform(0.3, 0.6), rng.uniform(0.5, 0.8))
    return _rgb(rng.uniform(0.5, 0.7), rng.uniform(0, 0.08), rng.uniform(0.5, 0.85))


def grey(level: SupportsInt) -> Color:
    return np.full(3, int(level), np.uint8)


def solid(color: Color, rows: int = 8, columns: int = 8) -> Image:
    return np.broadcast_to(np.asarray(color, np.uint8), (rows, columns, 3)).copy()


def blend(weight: Float[np.ndarray, "H W"], low: Color, high: Color) -> Image:
    """From one colour (weight 0) to another (weight 1)."""
    mix = np.clip(weight, 0, 1)[..., None]
    return (low * (1 - mix) + high * mix + 0.5).clip(0, 255).astype(np.uint8)


def noise(
    rng: np.random.Generator, rows: int, columns: int, octaves: int = 4
) -> Float[np.ndarray, "H W"]:
    """Value noise in [0, 1] of several octaves; it closes on itself from right to left."""
    total = np.zeros((rows, columns))
    first = int(rng.integers(2, 6))
    for octave in range(octaves):
        size = first * 2**octave
        grid = rng.random((size + 1, size))
        grid = np.concatenate([grid, grid[:, :2]], axis=1).astype(np.float32)
        wide = cv2.resize(
            grid, (columns + columns * 2 // size, rows), interpolation=cv2.INTER_CUBIC
        )
        start = columns // size
        total += wide[:, start : start + columns] * 0.5**octave
    low, high = total.min(), total.max()
    return (total - low) / max(high - low, 1e-9)


def _plain(rng: np.random.Generator, rows: int, columns: int) -> Image:
    return solid(random_color(rng), rows, columns)


def _gradient(rng: np.random.Generator, rows: int, columns: int) -> Image:
    ramp = np.linspace(0, 1, rows)[:, None] ** rng.uniform(0.5, 2.0)
    return blend(np.broadcast_to(ramp, (rows, columns)), random_color(rng), random_color(rng))


def _clouds(rng: np.random.Generator, rows: int, columns: int) -> Image:
    return blend(noise(rng, rows, columns), random_color(rng), random_color(rng))


def _glaze(rng: np.random.Generator, rows: int, columns: int) -> Image:
    """Two glazes meeting on an uneven line, as on pottery."""
    line = rng.uniform(0.25, 0.75) + 0.15 * (noise(rng, rows, columns, 3) - 0.5)
    height = np.linspace(1, 0, rows)[:, None]
    upper, lower = random_color(rng), random_color(rng)
    weight = np.clip((height - line) / rng.uniform(0.02, 0.2) + 0.5, 0, 1)
    return blend(weight, lower, upper)


def _marble(rng: np.random.Generator, rows: int, columns: int) -> Image:
    vein = np.abs(np.sin(np.pi * rng.integers(2, 6) * noise(rng, rows, columns, 5)))
    base = random_color(rng)
    return blend(vein ** rng.uniform(0.2, 1.0), near(base, rng, 60), base)


def _speckle(rng: np.random.Generator, rows: int, columns: int) -> Image:
    image = solid(random_color(rng), rows, columns)
    spots = cv2.GaussianBlur(rng.random((rows, columns)), (0, 0), rng.uniform(0.6, 2.0))
    image[spots > np.quantile(spots, rng.uniform(0.85, 0.98))] = random_color(rng)
    return image


def _bands(rng: np.random.Generator, rows: int, columns: int) -> Image:
    """Horizontal bands of two to four colours."""
    colors = [random_color(rng) for _ in range(int(rng.integers(2, 5)))]
    edges = np.sort(rng.integers(0, rows, int(rng.integers(2, 9))))
    index = np.searchsorted(edges, np.arange(rows)) % len(colors)
    return np.repeat(np.array(colors)[index][:, None], columns, axis=1)


def _stripes(rng: np.random.Generator, rows: int, columns: int) -> Image:
    """Upright or slanted stripes that meet where the image wraps."""
    u, v = _grid(rows, columns)
    phase = rng.integers(3, 20) * u + rng.choice([0.0, rng.uniform(-6, 6)]) * v
    return _two_colors(rng, np.mod(phase, 1) < rng.uniform(0.2, 0.8))


def _checks(rng: np.random.Generator, rows: int, columns: int) -> Image:
    u, v = _grid(rows, columns)
    count = int(rng.integers(2, 10))
    tall = max(1, round(count * rows / columns))
    return _two_colors(rng, (np.floor(2 * count * u) + np.floor(2 * tall * v)) % 2 == 0)


def _dots(rng: np.random.Generator, rows: int, columns: int) -> Image:
    u, v = _grid(rows, columns)
    count = int(rng.integers(4, 14))
    du = np.mod(count * u, 1) - 0.5
    dv = np.mod(count * v * rows / columns, 1) - 0.5
    return _two_colors(rng, du**2 + dv**2 < rng.uniform(0.2, 0.45) ** 2)


def _grid(rows: int, columns: int) -> tuple[Float[np.ndarray, "H W"], Float[np.ndarray, "H W"]]:
    u, v = np.meshgrid((np.arange(columns) + 0.5) / columns, (np.arange(rows) + 0.5) / rows)
    return u, v


def _two_colors(rng: np.random.Generator, mask: np.ndarray) -> Image:
    return blend(mask.astype(float), random_color(rng), random_color(rng))


PATTERNS: dict[str, tuple[float, Callable[[np.random.Generator, int, int], Image]]] = {
    "plain": (5.0, _plain),
    "gradient": (1.5, _gradient),
    "clouds": (1.0, _clouds),
    "glaze": (1.0, _glaze),
    "marble": (1.0, _marble),
    "speckle": (1.0, _speckle),
    "bands": (1.0, _bands),
    "stripes": (1.0, _stripes),
    "checks": (0.5, _checks),
    "dots": (0.7, _dots),
}
"""Name → (relative frequency, maker)."""


def any_pattern(rng: np.random.Generator, rows: int, columns: int) -> Image:
    """One of PATTERNS by their frequencies."""
    weights = np.array([weight for weight, _ in PATTERNS.values()])
    maker = list(PATTERNS.values())[int(rng.choice(len(PATTERNS), p=weights / weights.sum()))][1]
    return maker(rng, rows, columns)


def grain(image: Image, rng: np.random.Generator, strength: float = 3.0) -> Image:
    """Fine brightness noise, as no surface is perfectly even."""
    noisy = image + rng.normal(0, strength, (*image.shape[:2], 1))
    return noisy.clip(0, 255).astype(np.uint8)


def material(draw: Draw, matt: float = 0.4) -> Material:
    """Matt, satin or glossy; `matt` is the chance of the first."""
    kind = draw.choice("finish", {"matt": matt, "satin": (1 - matt) / 2, "glossy": (1 - matt) / 2})
    low, high = {"matt": (0.0, 0.08), "satin": (0.1, 0.3), "glossy": (0.3, 0.8)}[kind]
    specular = draw.uniform("specular", low, high)
    return Material(
        specular, float(draw.rng.uniform(8, 20) if kind == "matt" else draw.rng.uniform(20, 120))
    )


def _rgb(hue: float, saturation: float, value: float) -> Color:
    return (255 * np.array(colorsys.hsv_to_rgb(hue, saturation, value))).astype(np.uint8)


def mean_color(image: Image) -> Color:
    return image.reshape(-1, 3).mean(axis=0).astype(np.uint8)
