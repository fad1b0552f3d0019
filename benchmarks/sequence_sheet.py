"""Draw a sheet of frames of written recordings: colour with the target's outline above depth.

python benchmarks/sequence_sheet.py data/aerial --out sheet.png
"""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import tyro
from jaxtyping import UInt8
from tyro.conf import Positional

from robust6dof.data import read_video
from robust6dof.frames import RgbdFrame

_FARTHEST_M = 2.5


def main(
    folder: Positional[Path], out: Path, frames: int = 4, match: str = "*", scale: float = 0.4
) -> None:
    """Draw the sheet.

    Args:
        folder: of recordings.
        out: image to write.
        frames: of each recording, evenly spread.
        match: pattern of the recordings' names.
        scale: of the drawn frames.
    """
    found = sorted(path.parent for path in folder.glob(f"{match}/plan.json"))
    sheet = np.vstack([_row(path, frames, scale) for path in found])
    cv2.imwrite(str(out), cv2.cvtColor(sheet, cv2.COLOR_RGB2BGR))


def _row(path: Path, frames: int, scale: float) -> UInt8[np.ndarray, "H W 3"]:
    video = read_video(path)
    cells = []
    for index in np.linspace(0, len(video) - 1, frames).astype(int):
        mask = video.mask(int(index))
        cell = np.vstack([_outlined(video[int(index)], mask), _depth_colors(video[int(index)])])
        cells.append(cv2.resize(cell, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA))
    row = np.hstack(cells)
    cv2.putText(row, path.name, (6, 16), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (255, 255, 255), 2)
    cv2.putText(row, path.name, (6, 16), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (0, 0, 0), 1)
    return row


def _outlined(frame: RgbdFrame, mask: np.ndarray | None) -> UInt8[np.ndarray, "H W 3"]:
    rgb = frame.rgb.copy()
    if mask is not None:
        outlines, _ = cv2.findContours(
            mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE
        )
        cv2.drawContours(rgb, outlines, -1, (0, 255, 0), 2)
    return rgb


def _depth_colors(frame: RgbdFrame) -> UInt8[np.ndarray, "H W 3"]:
    """Near blue, far red, holes black."""
    share = np.clip(frame.depth / _FARTHEST_M, 0, 1) * 255
    colors = cv2.applyColorMap(share.astype(np.uint8), cv2.COLORMAP_TURBO)
    colors[frame.depth == 0] = 0
    return cv2.cvtColor(colors, cv2.COLOR_BGR2RGB)


if __name__ == "__main__":
    tyro.cli(main)
