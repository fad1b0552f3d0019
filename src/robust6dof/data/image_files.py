"""Images and matrices on disk: each unreadable file is refused by name, with what to do."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8, UInt16
from PIL import Image

from robust6dof.errors import DataError, InputError
from robust6dof.geometry.transforms import check_transform

_AGAIN = "Copy or record it again"


def read_color(path: Path) -> UInt8[np.ndarray, "H W 3"]:
    """Read a colour image as RGB.

    Raises:
        DataError: missing or truncated.
    """
    return np.asarray(_decode(path, "RGB"))


def read_depth(path: Path) -> UInt16[np.ndarray, "H W"]:
    """Read the raw 16-bit values of a depth image.

    Raises:
        DataError: missing, truncated, or a picture of depth (8 bits, several channels).
    """
    image = _decode(path)
    if image.mode not in ("I;16", "I;16B", "I"):
        raise DataError(
            path,
            f"this is a picture of depth (mode {image.mode}), not depth itself",
            "Depth must be a single-channel 16-bit PNG in millimetres",
        )
    return np.asarray(image).astype(np.uint16)


def read_mask(path: Path) -> Bool[np.ndarray, "H W"]:
    """Read an object mask: nonzero in any channel is the object.

    Raises:
        DataError: missing or truncated.
    """
    values = read_labels(path)
    return (values > 0) if values.ndim == 2 else (values > 0).max(axis=-1)


def read_labels(path: Path) -> np.ndarray:
    """Read an image of integer labels, [H, W] or [H, W, C] without its alpha channel.

    Raises:
        DataError: missing or truncated.
    """
    image = _decode(path)
    if image.mode in ("LA", "RGBA"):
        image = image.convert(image.mode[:-1])
    return np.asarray(image)


def image_size(path: Path) -> tuple[int, int]:
    """Width and height, without decoding the image."""
    _require(path)
    try:
        with Image.open(path) as image:
            return image.size
    except OSError as error:
        raise DataError(path, f"not a readable image ({error})", _AGAIN) from error


def read_matrix(path: Path, shape: tuple[int, int]) -> Float[np.ndarray, "R C"]:
    """Read a text matrix; commas, brackets and line breaks do not matter.

    Raises:
        DataError: missing, not numbers, or another count of them.
    """
    values = read_numbers(path)
    if values.size != shape[0] * shape[1]:
        raise DataError(
            path,
            f"{values.size} numbers where {shape[0]}×{shape[1]} are needed",
            f"Write the {shape[0]}×{shape[1]} matrix row by row",
        )
    return values.reshape(shape)


def read_numbers(path: Path) -> Float[np.ndarray, "N"]:
    """Read all numbers of a text file.

    Raises:
        DataError: missing, or not numbers.
    """
    try:
        return np.array([float(word) for word in _words(read_text(path))], dtype=np.float64)
    except ValueError as error:
        raise DataError(path, f"not a file of numbers ({error})", "Write plain numbers") from error


def read_text(path: Path) -> str:
    """Read a text file.

    Raises:
        DataError: missing, or not text.
    """
    _require(path)
    try:
        return path.read_text(encoding="utf-8")
    except (UnicodeDecodeError, OSError) as error:
        raise DataError(path, f"not a text file ({error})", _AGAIN) from error


def _words(text: str) -> list[str]:
    for character in ",;[]()":
        text = text.replace(character, " ")
    return text.split()


def read_transform(path: Path) -> Float[np.ndarray, "4 4"]:
    """Read a rigid 4×4 transform.

    Raises:
        DataError: missing, not a matrix, or not rigid.
    """
    T_dst_src = read_matrix(path, (4, 4))
    try:
        return check_transform(T_dst_src)
    except InputError as error:
        raise DataError(path, str(error), "Write a rigid 4×4 matrix in metres") from error


def write_image(path: Path, image: np.ndarray) -> None:
    """Write RGB (uint8), depth (uint16) or a mask (uint8) as the file's suffix says.

    Raises:
        DataError: the file cannot be written.
    """
    stored = image[..., ::-1] if image.ndim == 3 else image
    try:
        written = cv2.imwrite(str(path), np.ascontiguousarray(stored))
    except cv2.error:
        written = False
    if not written:
        raise DataError(path, "could not be written", "Check the folder and the free space")


def _decode(path: Path, mode: str | None = None) -> Image.Image:
    """Decode whole: unlike OpenCV, Pillow refuses a truncated JPEG instead of greying its rest."""
    _require(path)
    try:
        with Image.open(path) as image:
            image.load()
            return image.convert(mode) if mode else image.copy()
    except (OSError, SyntaxError, ValueError) as error:
        raise DataError(path, f"truncated or not an image ({error})", _AGAIN) from error


def _require(path: Path) -> None:
    if not path.is_file():
        raise DataError(path, "the file is missing", "Restore it, or name the right folder")
