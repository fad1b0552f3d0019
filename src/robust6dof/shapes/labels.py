"""Printed images: labels, logos, decorated pottery, screens, keyboards, camera fronts and lids."""

from __future__ import annotations

import string

import cv2
import numpy as np
from jaxtyping import UInt8

from robust6dof.shapes.textures import Color, Image, any_pattern, grey, near, random_color, solid

_FONTS = (
    cv2.FONT_HERSHEY_SIMPLEX,
    cv2.FONT_HERSHEY_DUPLEX,
    cv2.FONT_HERSHEY_TRIPLEX,
    cv2.FONT_HERSHEY_SCRIPT_SIMPLEX,
)


def label(rng: np.random.Generator, rows: int, columns: int) -> Image:
    """A wrap with a front and a back: ground, panel, logo, a name, small print, a bar code."""
    image = any_pattern(rng, rows, columns)
    half = columns // 2
    front = _face(rng, image[:, :half].copy())
    twice = rng.random() < 0.5
    back = front if twice else _small_print(rng, image[:, half : 2 * half].copy())
    whole = np.concatenate([front, back, image[:, 2 * half :]], axis=1)
    return np.roll(whole, int(rng.integers(columns)), axis=1)


def decorated(rng: np.random.Generator, rows: int, columns: int) -> Image:
    """Pottery: a pattern, often with a logo or a name on each side."""
    image = any_pattern(rng, rows, columns)
    if rng.random() < 0.45:
        return image
    half = columns // 2
    left = image[:, :half].copy()
    _logo(rng, left) if rng.random() < 0.6 else _name(rng, left, 0.5)
    return np.concatenate([left, left if rng.random() < 0.6 else image[:, half:]], axis=1)


def can_lid(rng: np.random.Generator, color: Color, opened: bool, size: int = 64) -> Image:
    """Turned metal seen from above (radius over v, angle over u): rings and an opening."""
    image = solid(color, size, size).astype(float)
    image += 14 * np.sin(np.linspace(0, rng.uniform(6, 30), size))[:, None, None]
    image += 10 * np.sin(np.linspace(0, 4 * np.pi, size, endpoint=False))[None, :, None]
    image = image.clip(0, 255).astype(np.uint8)
    if opened:
        start = int(rng.integers(size // 2))
        image[int(0.35 * size) : int(0.8 * size), start : start + size // 5] = 15
    return image


def screen(rng: np.random.Generator, rows: int, columns: int) -> Image:
    """Off, a wallpaper, a window, or lines of text; with a bezel around."""
    kind = rng.choice(["off", "wallpaper", "windows", "code"], p=[0.3, 0.25, 0.25, 0.2])
    makers = {"wallpaper": any_pattern, "windows": _windows, "code": _code}
    dark = grey(rng.integers(3, 25))
    image = makers[kind](rng, rows, columns) if kind != "off" else solid(dark, rows, columns)
    bezel = grey(rng.choice([8, 20, 200], p=[0.5, 0.35, 0.15]))
    side, chin = int(rng.integers(2, 7)), int(rng.integers(3, 13))
    framed = solid(bezel, rows, columns)
    framed[side : rows - chin, side : columns - side] = image[
        side : rows - chin, side : columns - side
    ]
    return framed


def keyboard(rng: np.random.Generator, rows: int, columns: int, shade: Color) -> Image:
    """Keys, a touchpad and perhaps speakers or a number pad on the shell's colour; hinge on top."""
    image = solid(shade, rows, columns)
    keys = grey(rng.choice([15, 40, 120, 235], p=[0.55, 0.2, 0.05, 0.2]))
    margin = int(columns * rng.uniform(0.03, 0.12))
    top, bottom = int(rows * rng.uniform(0.06, 0.16)), int(rows * rng.uniform(0.52, 0.64))
    if rng.random() < 0.4:
        image[top - 2 : bottom + 2, margin - 2 : columns - margin + 2] = near(shade, rng, 25)
    _keys(rng, image[top:bottom, margin : columns - margin], keys)
    width, middle = int(columns * rng.uniform(0.12, 0.22)), columns // 2
    low, high = bottom + max(3, rows // 20), int(rows * rng.uniform(0.88, 0.97))
    pad = np.clip(shade.astype(float) * rng.choice([0.8, 0.9, 1.1]), 0, 255).astype(np.uint8)
    image[low:high, middle - width : middle + width] = pad
    edge = tuple(int(c) for c in np.clip(shade * 0.6, 0, 255))
    cv2.rectangle(image, (middle - width, low), (middle + width, high), edge, 1)
    return image


def lid_back(rng: np.random.Generator, rows: int, columns: int, shade: Color) -> Image:
    """A laptop from behind: plain, with a logo or stickers."""
    image = solid(shade, rows, columns)
    if rng.random() < 0.6:
        middle = image[rows // 3 : 2 * rows // 3, columns // 3 : 2 * columns // 3]
        _logo(rng, middle) if rng.random() < 0.6 else _name(rng, middle, 0.5)
    for _ in range(int(rng.integers(0, 8)) if rng.random() < 0.2 else 0):
        centre = int(rng.integers(columns)), int(rng.integers(rows))
        axes = int(rng.integers(4, 16)), int(rng.integers(4, 12))
        cv2.ellipse(
            image, centre, axes, float(rng.uniform(0, 180)), 0, 360, _tuple(random_color(rng)), -1
        )
    return image


def camera_front(rng: np.random.Generator, image: Image, named: bool = True) -> Image:
    """A camera's front: a maker's name, a lamp, perhaps a coloured stripe."""
    image = image.copy()
    rows, columns = image.shape[:2]
    if rng.random() < 0.15:
        row = int(rng.integers(rows // 6, rows // 2))
        image[row : row + rows // 16 + 1] = random_color(rng)
    if named:
        strip = image[rows // 12 : rows // 4, int(0.3 * columns) : int(0.75 * columns)]
        _name(rng, strip, 0.5)
    lamp = int(rng.uniform(0.1, 0.9) * columns), int(rng.uniform(0.1, 0.3) * rows)
    cv2.circle(image, lamp, max(1, rows // 40), _tuple(random_color(rng)), -1)
    return image


def camera_back(rng: np.random.Generator, image: Image) -> Image:
    """A camera's back: a dark screen and round buttons (mirrored: seen from behind)."""
    image = image.copy()
    rows, columns = image.shape[:2]
    left, right = int(0.08 * columns), int(rng.uniform(0.6, 0.75) * columns)
    image[int(0.22 * rows) : int(0.9 * rows), left:right] = rng.integers(5, 35)
    for _ in range(int(rng.integers(2, 6))):
        centre = int(rng.uniform(0.8, 0.95) * columns), int(rng.uniform(0.25, 0.9) * rows)
        cv2.circle(image, centre, rows // 20 + 1, (70, 70, 70), -1)
    return image


def lens_barrel(rng: np.random.Generator, color: Color, rows: int, columns: int) -> Image:
    """Rings of ridged rubber and plain metal along the barrel (v), marks around it."""
    image = solid(color, rows, columns)
    for _ in range(int(rng.integers(1, 4))):
        start, height = int(rng.integers(rows)), int(rng.integers(rows // 10, rows // 3))
        part = image[start : start + height]
        part[:, ::2] = np.clip(color.astype(float) * rng.choice([0.5, 0.7, 1.5]), 0, 255)
    if rng.random() < 0.5:
        row = int(rng.integers(rows - 2))
        image[row : row + 2] = random_color(rng)
    return image


def _face(rng: np.random.Generator, image: Image) -> Image:
    rows, columns = image.shape[:2]
    if rng.random() < 0.6:
        _panel(rng, image)
    if rng.random() < 0.75:
        _logo(rng, image[: int(0.7 * rows)])
    _name(rng, image, rng.uniform(0.3, 0.8))
    for row in range(int(0.85 * rows), rows - 3, 4):
        length = int(rng.uniform(0.3, 0.7) * columns)
        start = (columns - length) // 2
        image[row, start : start + length] = near(image[row, start], rng, 90)
    return image


def _small_print(rng: np.random.Generator, image: Image) -> Image:
    rows, columns = image.shape[:2]
    ink = random_color(rng)
    for row in range(rows // 8, int(0.6 * rows), 4):
        dashes = rng.random(columns // 2) < 0.7
        image[row : row + 2, columns // 8 : columns // 8 + len(dashes)][:, dashes] = ink
    bars = np.where(rng.random(columns // 4) < 0.5, 10, 245).astype(np.uint8)
    top, left = int(0.68 * rows), columns // 3
    image[top : int(0.9 * rows), left : left + len(bars)] = bars[None, :, None]
    return image


def _panel(rng: np.random.Generator, image: Image) -> None:
    rows, columns = image.shape[:2]
    color = _tuple(random_color(rng))
    if rng.random() < 0.5:
        top, left = int(rng.uniform(0.05, 0.3) * rows), int(rng.uniform(0.05, 0.25) * columns)
        cv2.rectangle(image, (left, top), (columns - left, rows - top), color, -1)
    else:
        axes = int(rng.uniform(0.25, 0.45) * columns), int(rng.uniform(0.2, 0.45) * rows)
        cv2.ellipse(image, (columns // 2, rows // 2), axes, 0, 0, 360, color, -1)


def _logo(rng: np.random.Generator, image: UInt8[np.ndarray, "_ _ 3"]) -> None:
    """A disc, ring, star or blob in the middle, drawn in place."""
    rows, columns = image.shape[:2]
    canvas = np.ascontiguousarray(image)
    centre, size = np.array([columns / 2, rows / 2]), rng.uniform(0.15, 0.4) * min(rows, columns)
    points = int(rng.integers(3, 9))
    angle = np.arange(2 * points) * np.pi / points + rng.uniform(0, np.pi)
    radius = size * np.where(np.arange(2 * points) % 2, rng.uniform(0.35, 1.0), 1.0)
    star = centre + radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
    color, middle = _tuple(random_color(rng)), (int(centre[0]), int(centre[1]))
    if rng.random() < 0.5:
        cv2.fillPoly(canvas, [np.round(star).astype(np.int32)], color)
    else:
        cv2.circle(canvas, middle, int(size), color, -1 if rng.random() < 0.6 else 3)
    if rng.random() < 0.5:
        cv2.circle(canvas, middle, max(1, int(size / 2)), _tuple(random_color(rng)), -1)
    image[:] = canvas


def _name(rng: np.random.Generator, image: UInt8[np.ndarray, "_ _ 3"], height: float) -> None:
    """A word of random letters across the image at a relative height, drawn in place."""
    rows, columns = image.shape[:2]
    canvas = np.ascontiguousarray(image)
    word = "".join(rng.choice(list(string.ascii_uppercase), int(rng.integers(3, 8))))
    font, bold = _FONTS[int(rng.integers(len(_FONTS)))], int(rng.integers(1, 4))
    (width, _), _ = cv2.getTextSize(word, font, 1.0, bold)
    scale = min(rng.uniform(0.5, 0.95) * columns / width, rows / 30)
    origin = int((columns - scale * width) / 2), int(height * rows + 10 * scale)
    paint = grey(245) if canvas.mean() < 120 else grey(15)
    color = paint if rng.random() < 0.5 else random_color(rng)
    cv2.putText(canvas, word, origin, font, scale, _tuple(color), bold, cv2.LINE_AA)
    image[:] = canvas


def _windows(rng: np.random.Generator, rows: int, columns: int) -> Image:
    image = any_pattern(rng, rows, columns)
    for _ in range(int(rng.integers(1, 4))):
        left, top = int(rng.uniform(0.05, 0.5) * columns), int(rng.uniform(0.05, 0.4) * rows)
        right, low = left + int(0.45 * columns), top + int(0.5 * rows)
        image[top:low, left:right] = rng.choice([30, 245])
        image[top : top + 4, left:right] = random_color(rng)
        for row in range(top + 8, min(low, rows) - 3, 5):
            image[row : row + 2, left + 4 : left + int(rng.uniform(8, right - left))] = 128
    image[-6:] = rng.choice([20, 230])
    return image


def _code(rng: np.random.Generator, rows: int, columns: int) -> Image:
    image = solid(grey(rng.choice([18, 30, 250])), rows, columns)
    for row in range(8, rows - 8, 4):
        left = 10 + 6 * int(rng.integers(0, 5))
        while left < columns * rng.uniform(0.2, 0.9):
            width = int(rng.integers(4, 18))
            image[row : row + 2, left : left + width] = random_color(rng)
            left += width + 3
    return image


def _keys(rng: np.random.Generator, image: UInt8[np.ndarray, "_ _ 3"], color: Color) -> None:
    """Five or six rows of keys with a space bar, drawn in place."""
    rows, columns = image.shape[:2]
    count, across = int(rng.integers(5, 7)), int(rng.integers(13, 18))
    for line in range(count):
        top, low = round(line * rows / count), round((line + 1) * rows / count) - 1
        shift = 0.35 * line * columns / across / count
        for place in range(across):
            left, right = place * columns / across + shift, (place + 1) * columns / across + shift
            if line == count - 1 and across // 4 < place < across // 2 + 1:
                right += 1  # the space bar has no gaps
            image[top:low, round(left) : max(round(right) - 1, 0)] = color


def _tuple(color: Color) -> tuple[int, int, int]:
    return int(color[0]), int(color[1]), int(color[2])
