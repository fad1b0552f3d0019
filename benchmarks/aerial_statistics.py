"""Measure written aerial recordings: motion between frames, blur, visibility; as a table.

python benchmarks/aerial_statistics.py data/aerial
"""

from __future__ import annotations

import itertools
import json
from collections import defaultdict
from pathlib import Path

import numpy as np
import tyro
from jaxtyping import Float
from tyro.conf import Positional

from robust6dof.data.truth_file import FILE_NAME, AnnotatedTruth, read_truth_file
from robust6dof.geometry.transforms import rotation_error
from robust6dof.rendering.d435i import FOCAL_PX
from robust6dof.synthetic.aerial import MOTION_FILE
from robust6dof.synthetic.difficulty import DIFFICULTIES

Samples = dict[str, list[float]]

QUANTITIES = {
    "turn between frames [°]": (0.5, 0.9, 0.99, 1.0),
    "shift between frames [cm]": (0.5, 0.9, 0.99, 1.0),
    "shift in the image [px]": (0.5, 0.9, 0.99, 1.0),
    "camera's rate [°/s]": (0.5, 0.9, 0.99, 1.0),
    "camera's speed [m/s]": (0.5, 0.9, 0.99, 1.0),
    "blur of the target [px]": (0.5, 0.9, 0.99, 1.0),
    "distance [m]": (0.0, 0.5, 0.9, 1.0),
    "visible share": (0.0, 0.1, 0.5, 0.9),
}
"""What is measured, and the quantiles printed of it."""


def main(folder: Positional[Path]) -> None:
    """Print one table, a column for each difficulty.

    Args:
        folder: of recordings as `robust6dof synthesize aerial` writes them.
    """
    samples: dict[str, Samples] = defaultdict(lambda: defaultdict(list))
    counts: dict[str, list[int]] = defaultdict(lambda: [0, 0, 0])
    for path in sorted(folder.glob("*/plan.json")):
        plan = json.loads(path.read_text())
        measured = measure(path.parent)
        for name, values in measured.items():
            samples[plan["difficulty"]][name] += values
        count = counts[plan["difficulty"]]
        frames = len(measured["visible share"])
        count[0] += 1
        count[1] += frames
        count[2] += plan["frames"] - frames
    columns = [name for name in DIFFICULTIES if name in samples]
    print(table(columns, samples, counts))


def measure(recording: Path) -> Samples:
    """Samples of each quantity of one recording."""
    truths = read_truth_file(recording / FILE_NAME)
    motions = [json.loads(line) for line in (recording / MOTION_FILE).read_text().splitlines()]
    samples: Samples = defaultdict(list)
    for before, after in itertools.pairwise(truths):
        if (after.stamp or 0) - (before.stamp or 0) < 1.5 / 30:  # no frame was lost between
            _compare(before, after, samples)
    for truth, motion in zip(truths, motions, strict=True):
        twist = np.array(motion["camera_twist"])
        samples["camera's rate [°/s]"].append(float(np.rad2deg(np.linalg.norm(twist[3:]))))
        samples["camera's speed [m/s]"].append(float(np.linalg.norm(twist[:3])))
        samples["distance [m]"].append(float(np.linalg.norm(truth.T_cam_obj[:3, 3])))
        samples["visible share"].append(truth.visible_fraction or 0.0)
        if truth.T_cam_obj[2, 3] > 0:
            flow = image_velocity(truth.T_cam_obj[:3, 3], np.array(motion["target_twist"]))
            blur = float(np.linalg.norm(flow)) * motion["exposure_s"]
            samples["blur of the target [px]"].append(blur)
    return samples


def _compare(before: AnnotatedTruth, after: AnnotatedTruth, samples: Samples) -> None:
    one, other = before.T_cam_obj, after.T_cam_obj
    turn = float(np.rad2deg(rotation_error(one[:3, :3], other[:3, :3])))
    samples["turn between frames [°]"].append(turn)
    shift = float(np.linalg.norm(one[:3, 3] - other[:3, 3]))
    samples["shift between frames [cm]"].append(100 * shift)
    if one[2, 3] > 0 and other[2, 3] > 0:
        pixels = [FOCAL_PX * T[:2, 3] / T[2, 3] for T in (one, other)]
        samples["shift in the image [px]"].append(float(np.linalg.norm(pixels[0] - pixels[1])))


def image_velocity(
    point_cam: Float[np.ndarray, "3"], twist: Float[np.ndarray, "6"]
) -> Float[np.ndarray, "2"]:
    """Velocity in the image [px/s] of a point seen by a camera that moves with `twist`."""
    velocity = -twist[:3] - np.cross(twist[3:], point_cam)
    return FOCAL_PX * (velocity[:2] - point_cam[:2] / point_cam[2] * velocity[2]) / point_cam[2]


def table(columns: list[str], samples: dict[str, Samples], counts: dict[str, list[int]]) -> str:
    """The statistics as Markdown."""
    lines = ["| | quantiles | " + " | ".join(columns) + " |", "|---" * (len(columns) + 2) + "|"]
    lines.append(_line("recordings", "", [str(counts[c][0]) for c in columns]))
    lost = [f"{counts[c][1]} ({counts[c][2]})" for c in columns]
    lines.append(_line("frames (lost)", "", lost))
    for name, quantiles in QUANTITIES.items():
        values = [np.quantile(samples[c][name], quantiles) for c in columns]
        cells = [" / ".join(f"{v:.3g}" for v in row) for row in values]
        lines.append(_line(name, " / ".join(_quantile_name(q) for q in quantiles), cells))
    hidden = [np.mean(np.array(samples[c]["visible share"]) < 0.1) for c in columns]
    lines.append(_line("frames with less than a tenth visible", "", [f"{h:.1%}" for h in hidden]))
    return "\n".join(lines)


def _quantile_name(quantile: float) -> str:
    return {0.0: "least", 0.5: "median", 1.0: "most"}.get(quantile, f"{quantile:.0%}")


def _line(name: str, quantiles: str, cells: list[str]) -> str:
    return f"| {name} | {quantiles} | " + " | ".join(cells) + " |"


if __name__ == "__main__":
    tyro.cli(main)
