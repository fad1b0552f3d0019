"""Say what a folder is, whether its units, intrinsics, masks and poses make sense, and draw it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from robust6dof.cli.options import CommonOptions

if TYPE_CHECKING:
    import numpy as np

    from robust6dof.data.dataset import Dataset
    from robust6dof.data.inspection import Sample

SIGNS = {"ok": "ok      ", "note": "note    ", "problem": "PROBLEM "}


@dataclass(frozen=True, kw_only=True)
class Options(CommonOptions):
    path: Annotated[Path, tyro.conf.Positional]
    """Folder of a recording or of a data set."""
    out: Path = Path("doctor.png")
    """Where to draw one frame with its annotations: colour beside depth."""
    frames: int = 8
    """How many frames to look at, spread over the whole."""
    models: Path | None = None
    """Object models of YCB-Video, where they are not in its models/ folder."""
    depth_only: bool = False
    """Leave the colour of recordings alone (it is not registered to the depth)."""


def run(options: Options) -> None:
    """Print the findings; fail where there is a problem."""
    from robust6dof.data.image_files import write_image
    from robust6dof.data.inspection import inspect_folder
    from robust6dof.errors import DataError

    inspection = inspect_folder(options.path, options.frames, lambda _: _open(options))
    for finding in inspection.findings:
        print(f"{SIGNS[finding.level]} {finding.text}")
    if inspection.samples:
        sample = max(inspection.samples, key=lambda sample: len(sample.truths))
        options.out.parent.mkdir(parents=True, exist_ok=True)
        write_image(options.out, picture(sample))
        print(f"{SIGNS['ok']} {sample.label} is drawn in {options.out}")
    if inspection.problems:
        raise DataError(
            options.path, f"{inspection.problems} problem(s) found", "See the lines above"
        )


def _open(options: Options) -> Dataset:
    from robust6dof.data import open_dataset
    from robust6dof.data.truth_file import open_with_truth

    if options.depth_only or options.models is not None:
        return open_dataset(options.path, options.depth_only, options.models)
    return open_with_truth(options.path)


def picture(sample: Sample) -> np.ndarray:
    """Colour beside depth, both with masks, boxes and axes; RGB."""
    import numpy as np

    from robust6dof.visualization.overlay import colorize_depth, draw_label

    depth = sample.frame.depth
    valid = depth[depth > 0] if (depth > 0).any() else np.ones(1)
    near, far = np.quantile(valid, [0.02, 0.98]) * [0.9, 1.1]
    panels = [_annotated(colorize_depth(depth, float(near), float(far)), sample)]
    if sample.frame.has_color:
        panels.insert(0, _annotated(sample.frame.rgb, sample))
    names = ", ".join(truth.name for truth in sample.truths) or "no annotation"
    return draw_label(np.concatenate(panels, axis=1), f"{sample.label}: {names}")


def _annotated(image: np.ndarray, sample: Sample) -> np.ndarray:
    import cv2
    import numpy as np

    from robust6dof.visualization.overlay import GREEN, draw_box_and_axes

    image = np.ascontiguousarray(image).copy()
    for truth in sample.truths:
        if truth.mask is not None:
            outlines, _ = cv2.findContours(
                truth.mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE
            )
            cv2.drawContours(image, outlines, -1, (255, 255, 255), 1)
        if truth.extents is not None:
            image = draw_box_and_axes(image, sample.frame.K, truth.T_cam_box, truth.extents, GREEN)
        elif truth.T_cam_obj[2, 3] > 0:
            rotation, _ = cv2.Rodrigues(truth.T_cam_obj[:3, :3])
            translation = truth.T_cam_obj[:3, 3]
            cv2.drawFrameAxes(image, sample.frame.K, None, rotation, translation, 0.05, 2)
    return image
