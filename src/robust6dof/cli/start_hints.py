"""Where the object is in the first frame: what `robust6dof track` was told."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from robust6dof.cli.track import Options
    from robust6dof.frames import Box, RgbdFrame
    from robust6dof.tracking.segmentation import Segmenter


def start_hints(options: Options, frame: RgbdFrame) -> dict[str, Any]:
    """Arguments of `start`: mask, box or pose; the extents with any of them.

    Raises:
        InputError: more than one hint, one that cannot be read, nothing found.
        DataError: an unusable file.
        MissingExtraError: what Mask R-CNN needs is not installed.
    """
    from robust6dof.data.image_files import read_mask, read_transform
    from robust6dof.errors import InputError

    names = ("mask", "box", "click", "start")
    given = [name for name in names if getattr(options, name) is not None]
    if len(given) > 1:
        raise InputError(f"give only one of --{' and --'.join(given)}")
    hints: dict[str, Any] = {}
    if options.mask is not None:
        hints["mask"] = read_mask(options.mask)
    elif options.box is not None:
        hints["box"] = _read_box(options.box)
    elif options.start is not None:
        hints["T_cam_obj"] = read_transform(options.start)
    else:
        hints |= _segmented(options, frame)
    if options.extents is not None:
        import numpy as np

        hints["extents"] = np.array(_numbers(options.extents, 3, "--extents x,y,z"))
    return hints


def _segmented(options: Options, frame: RgbdFrame) -> dict[str, Any]:
    """The mask of what was clicked on, or that Mask R-CNN is surest of; else nothing."""
    from robust6dof.errors import InputError
    from robust6dof.tracking.segmentation import segment_click

    segmenter = _segmenter(options)
    if options.click is not None:
        x, y = _numbers(options.click, 2, "--click x,y")
        return {"mask": segment_click(frame, x, y, segmenter).mask}
    if segmenter is None:
        return {}
    found = segmenter.segment(frame)
    if not found:
        raise InputError(
            f"Mask R-CNN sees no {options.category} in the first frame; give --mask, --box or "
            "--click, or start on another frame with --first"
        )
    return {"mask": found[0].mask}


def _segmenter(options: Options) -> Segmenter | None:
    """None stands for the depth clusters, which the tracker has itself."""
    from robust6dof.errors import InputError

    if options.segmenter == "depth":
        if options.segmenter_weights is not None:
            raise InputError("--segmenter-weights goes with --segmenter mask-rcnn")
        return None
    if options.segmenter_weights is None:
        raise InputError("--segmenter mask-rcnn needs --segmenter-weights FILE.onnx")
    from robust6dof.tracking.segmenters.mask_rcnn import MaskRcnn

    return MaskRcnn.from_file(options.segmenter_weights, options.category)


def _read_box(text: str) -> Box:
    from robust6dof.frames import Box

    return Box(*_numbers(text, 4, "--box x,y,width,height"))


def _numbers(text: str, count: int, form: str) -> list[float]:
    from robust6dof.errors import InputError

    try:
        numbers = [float(part) for part in text.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != count:
        raise InputError(f"'{text}' does not read {form}")
    return numbers
