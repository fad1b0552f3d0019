"""How far two beliefs of where and how large the object is lie apart."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from robust6dof.geometry.transforms import orientation_error


@dataclass(frozen=True)
class Disagreement:
    """Between two poses and scales."""

    rotation: float
    """[rad]; of the y axes alone where the object is symmetric."""
    translation: float
    """[m]"""
    log_scale: float
    """Logarithm of the second scale over the first."""

    @classmethod
    def between(
        cls,
        T_a: Float[np.ndarray, "4 4"],
        scale_a: float,
        T_b: Float[np.ndarray, "4 4"],
        scale_b: float,
        symmetric: bool,
    ) -> Disagreement:
        """Of two object frames in the camera and their box diagonals [m]."""
        return cls(
            orientation_error(T_a[:3, :3], T_b[:3, :3], symmetric),
            float(np.linalg.norm(T_a[:3, 3] - T_b[:3, 3])),
            float(np.log(scale_b / scale_a)),
        )
