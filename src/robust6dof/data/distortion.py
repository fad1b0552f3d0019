"""Lens distortion: undone where the model is OpenCV's, refused where it is not understood."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float

from robust6dof.data.image_files import read_text
from robust6dof.errors import DataError, InputError

OPENCV_MODELS = ("opencv", "plumb_bob", "brown_conrady", "rational_polynomial")
"""Names under which recorders write OpenCV's polynomial model."""
OPENCV_COUNTS = (4, 5, 8, 12, 14)
"""Counts of coefficients that OpenCV's model has: k1 k2 p1 p2 [k3 [k4 k5 k6 [s1-s4 [tx ty]]]]."""


@dataclass(frozen=True, eq=False)
class Distortion:
    """OpenCV's polynomial lens distortion of the colour camera."""

    coefficients: Float[np.ndarray, "N"]
    """k1 k2 p1 p2 [k3 [k4 k5 k6 [s1 s2 s3 s4 [tx ty]]]]."""

    def __post_init__(self) -> None:
        count = len(self.coefficients)
        if count not in OPENCV_COUNTS or not np.isfinite(self.coefficients).all():
            raise InputError(
                f"{count} distortion coefficients; OpenCV's model has 4, 5, 8, 12 or 14 finite ones"
            )

    def undistort(self, image: np.ndarray, K: Float[np.ndarray, "3 3"], smooth: bool) -> np.ndarray:
        """Resample as a pinhole with the same K sees it; depth and masks with `smooth` False."""
        if not self.coefficients.any():
            return image
        size = (image.shape[1], image.shape[0])
        map_x, map_y = cv2.initUndistortRectifyMap(
            K, self.coefficients, np.eye(3), K, size, cv2.CV_32FC1
        )
        interpolation = cv2.INTER_LINEAR if smooth else cv2.INTER_NEAREST
        return cv2.remap(image, map_x, map_y, interpolation, borderMode=cv2.BORDER_CONSTANT)


def read_distortion(path: Path) -> Distortion:
    """Read `dist_coeffs.txt`: the coefficients, after the model's name where it is given.

    Raises:
        DataError: a model that is not OpenCV's polynomial one, or another count of numbers.
    """
    words = read_text(path).replace(",", " ").replace("[", " ").replace("]", " ").split()
    if words and words[0][:1].isalpha():
        model = words.pop(0).lower()
        if model not in OPENCV_MODELS and any(word.strip("0.+-") for word in words):
            raise DataError(
                path,
                f"lens model '{model}' is not understood",
                f"Undistort the images first, or give one of {', '.join(OPENCV_MODELS)}",
            )
    try:
        return Distortion(np.array([float(word) for word in words], dtype=np.float64))
    except (ValueError, InputError) as error:
        raise DataError(
            path, str(error), "Write k1 k2 p1 p2 [k3 …], or undistort the images first"
        ) from error
