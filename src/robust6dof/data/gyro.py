"""The optional `gyro.csv` of a recording: how its camera turned from frame to frame."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from jaxtyping import Float

from robust6dof.data.image_files import read_matrix, read_text
from robust6dof.errors import DataError, InputError
from robust6dof.geometry.gyro import check_rates, integrate_rates
from robust6dof.geometry.transforms import check_rotation

GYRO_FILE = "gyro.csv"
GYRO_AXES_FILE = "R_cam_gyro.txt"
HEADER = "stamp,wx,wy,wz"

_LONGEST_GAP_S = 0.1
"""Between two samples."""
_FAST_THROUGHOUT = 6.0
"""No recording is as fast for half its time [rad/s]."""
_REMEDY = (
    f"Write {HEADER}: seconds on the clock of stamps.txt, then rad/s about the camera's x (right), "
    "y (down) and z (forward); or remove the file"
)


def frame_orientations(
    path: Path, stamps: tuple[float | None, ...]
) -> tuple[Float[np.ndarray, "3 3"] | None, ...]:
    """`R_ref_cam` of each frame by the folder's `gyro.csv`; empty where there is none.

    None for frames before or after its samples. Rates in other axes than the colour camera's are
    turned by `R_cam_gyro.txt` (3×3), if there is one.

    Args:
        path: the recording.
        stamps: of its frames [s].

    Raises:
        DataError: the file cannot be understood, has gaps, is not in rad/s, or not of the frames'
            time.
    """
    file = path / GYRO_FILE
    if not file.is_file():
        return ()
    times = [stamp for stamp in stamps if stamp is not None]
    if len(times) < len(stamps):
        raise DataError(file, "the frames' times are not known", "Write stamps.txt, or give fps")
    samples = _read_samples(file)
    rates = samples[:, 1:] @ _read_axes(path / GYRO_AXES_FILE).T
    orientations = tuple(integrate_rates(samples[:, 0], rates, np.array(times)))
    if times and all(one is None for one in orientations):
        first, last = samples[0, 0], samples[-1, 0]
        problem = f"its {first:.3f} to {last:.3f} s hold no frame: is it of another clock?"
        raise DataError(file, problem, _REMEDY)
    return orientations


def write_gyro(path: Path, stamps: Float[np.ndarray, "S"], rates: Float[np.ndarray, "S 3"]) -> None:
    """Write `gyro.csv` of the recording at `path`: times [s], angular velocities [rad/s]."""
    rows = np.column_stack([stamps, rates])
    formats = ["%.6f", "%.7f", "%.7f", "%.7f"]
    np.savetxt(path / GYRO_FILE, rows, formats, delimiter=",", header=HEADER, comments="")


def _read_samples(file: Path) -> Float[np.ndarray, "S 4"]:
    """Times [s] and angular velocities [rad/s]."""
    lines = [line for line in read_text(file).splitlines() if line.strip()]
    if lines and lines[0].lstrip().startswith("stamp"):
        lines = lines[1:]
    try:
        rows = [[float(word) for word in line.split(",")] for line in lines]
        samples = np.array(rows, dtype=np.float64).reshape(len(rows), 4)
        check_rates(samples[:, 1:])
    except (ValueError, InputError) as error:
        raise DataError(file, f"not a gyro's samples ({error})", _REMEDY) from error
    problem = _problem(samples)
    if problem:
        raise DataError(file, problem, _REMEDY)
    return samples


def _problem(samples: Float[np.ndarray, "S 4"]) -> str | None:
    if len(samples) < 2:
        return "there are not even two samples"
    gaps = np.diff(samples[:, 0])
    if not (gaps > 0).all():
        return "the times do not increase"
    if gaps.max() > _LONGEST_GAP_S:
        return f"there is nothing for {gaps.max():.2f} s: the turn in such a gap is not known"
    usual = float(np.median(np.linalg.norm(samples[:, 1:], axis=-1)))
    if usual > _FAST_THROUGHOUT:
        return f"{usual:.0f} rad/s for half the time: are these degrees per second?"
    return None


def _read_axes(file: Path) -> Float[np.ndarray, "3 3"]:
    if not file.is_file():
        return np.eye(3)
    try:
        return check_rotation(read_matrix(file, (3, 3)))
    except InputError as error:
        raise DataError(file, str(error), "Write the rotation row by row") from error
