"""The cameras of a recording: intrinsics, depth camera, lens, from files or from the caller."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from robust6dof.data.distortion import Distortion, read_distortion
from robust6dof.data.image_files import read_matrix, read_transform
from robust6dof.errors import DataError, InputError
from robust6dof.geometry.camera import check_intrinsics

CENTRE_BAND = (0.3, 0.7)
"""Share of width and height within which a principal point lies: half or double size does not."""


@dataclass(frozen=True, eq=False)
class Calibration:
    """What turns the stored images into registered pinhole frames."""

    K: Float[np.ndarray, "3 3"]
    """Intrinsics of the colour camera, and of the depth where that is registered [px]."""
    K_source: Path
    """File that K came from, for messages."""
    K_depth: Float[np.ndarray, "3 3"] | None = None
    """Intrinsics of a separate depth camera; None where depth is registered to colour."""
    T_color_depth: Float[np.ndarray, "4 4"] | None = None
    """Depth-camera to colour-camera coordinates, where the two differ and it is known."""
    distortion: Distortion | None = None
    """Lens of the colour camera (and of depth registered to it)."""


def read_calibration(
    path: Path,
    intrinsics: Path,
    K_depth: np.ndarray | None = None,
    T_color_depth: np.ndarray | None = None,
    dist_coeffs: np.ndarray | None = None,
) -> Calibration:
    """Read `intrinsics` and the optional files of the folder; what the caller gives goes first.

    The optional files are `cam_K_depth.txt` (3×3) and `T_color_depth.txt` (4×4, metres) for a
    depth camera of its own, `dist_coeffs.txt` (OpenCV's order) for the colour camera's lens.

    Raises:
        DataError: a file that cannot be read or understood.
    """
    if K_depth is None and (path / "cam_K_depth.txt").is_file():
        K_depth = read_matrix(path / "cam_K_depth.txt", (3, 3))
    if T_color_depth is None and (path / "T_color_depth.txt").is_file():
        T_color_depth = read_transform(path / "T_color_depth.txt")
    return Calibration(
        _read_intrinsics(intrinsics),
        intrinsics,
        None if K_depth is None else np.asarray(K_depth, dtype=np.float64),
        None if T_color_depth is None else np.asarray(T_color_depth, dtype=np.float64),
        _read_distortion(path / "dist_coeffs.txt", dist_coeffs),
    )


def _read_intrinsics(path: Path) -> np.ndarray:
    if not path.is_file():
        raise DataError(
            path, "the intrinsics are missing", "Write fx 0 cx / 0 fy cy / 0 0 1 into that file"
        )
    return read_matrix(path, (3, 3))


def _read_distortion(path: Path, dist_coeffs: np.ndarray | None) -> Distortion | None:
    if dist_coeffs is not None:
        return Distortion(np.asarray(dist_coeffs, dtype=np.float64).ravel())
    return read_distortion(path) if path.is_file() else None


def fit_intrinsics(K: np.ndarray, size: tuple[int, int], source: Path) -> Float[np.ndarray, "3 3"]:
    """Check K against the width and height of the images it is said to belong to.

    Raises:
        DataError: no pinhole matrix, or that of another image size.
    """
    remedy = f"Give the intrinsics of the {size[0]}×{size[1]} images, in pixels, row by row"
    try:
        K = check_intrinsics(K, *size)
    except InputError as error:
        raise DataError(source, str(error), remedy) from error
    shares = K[:2, 2] / size
    if (shares < CENTRE_BAND[0]).any() or (shares > CENTRE_BAND[1]).any():
        raise DataError(
            source,
            f"the principal point ({K[0, 2]:.1f}, {K[1, 2]:.1f}) px is far from the centre of a "
            f"{size[0]}×{size[1]} image",
            remedy,
        )
    return K
