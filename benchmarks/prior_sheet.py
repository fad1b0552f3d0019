"""Draw the shipped priors, and beside them published mean shapes, as dots shaded by depth.

python benchmarks/prior_sheet.py --out priors.png [--published mean_points_emb.npy]
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import tyro
from jaxtyping import Float, UInt8
from scipy.spatial.transform import Rotation

from robust6dof.frames import CATEGORIES
from robust6dof.geometry.transforms import make_transform
from robust6dof.shapes.priors import load_prior

_CELL_PX = 220
_VIEWS_DEG = ((35, 25), (200, 25))
"""Azimuth and elevation."""


def main(out: Path, published: Path | None = None) -> None:
    """Draw the sheet: a column for each category; ours from two sides, then the published.

    Args:
        out: image to write.
        published: (6, N, 3) points, order bottle … mug.
    """
    rows = [[load_prior(category).astype(float) for category in CATEGORIES]]
    if published is not None:
        means = np.load(published).astype(float)
        rows.append([mean / np.linalg.norm(np.ptp(mean, axis=0)) for mean in means])
    cells = [
        np.hstack([_draw(points, *view) for points in row]) for row in rows for view in _VIEWS_DEG
    ]
    cv2.imwrite(str(out), np.vstack(cells))


def _draw(
    points: Float[np.ndarray, "N 3"], azimuth_deg: float, elevation_deg: float
) -> UInt8[np.ndarray, "H W 3"]:
    """Near points dark and on top; y up."""
    R = Rotation.from_euler("yx", [-azimuth_deg, elevation_deg], degrees=True).as_matrix()
    T_view_obj = make_transform(np.diag([1.0, -1.0, -1.0]) @ R, np.zeros(3))
    seen = points @ T_view_obj[:3, :3].T
    seen = seen[np.argsort(-seen[:, 2])]
    near = (seen[:, 2].max() - seen[:, 2]) / np.ptp(seen[:, 2])
    cell = np.full((_CELL_PX, _CELL_PX, 3), 255, np.uint8)
    for (x, y, _), share in zip(seen, near, strict=True):
        at = (round((0.5 + 0.9 * x) * _CELL_PX), round((0.5 + 0.9 * y) * _CELL_PX))
        cv2.circle(cell, at, 2, (round(225 - 190 * share),) * 3, -1, cv2.LINE_AA)
    return cell


if __name__ == "__main__":
    tyro.cli(main)
