"""Mask R-CNN through ONNX Runtime, which has RoIAlign and NMS of its own (extra `segmenter`)."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from jaxtyping import UInt8

from robust6dof.errors import DataError, MissingExtraError
from robust6dof.frames import CATEGORIES
from robust6dof.tracking.segmenters.mask_rcnn import Detections, Weights

CATEGORIES_KEY = "robust6dof.categories"
"""Metadata of the file: JSON list of the names of class 1, 2, …; by default the paper's six."""

OUTPUTS = ("boxes", "labels", "scores", "masks")
"""As torchvision's export gives them, in this order where they have other names."""


def load_onnx(path: Path) -> Weights:
    """Open an exported Mask R-CNN.

    It takes an image [3, H, W], 0 to 1, and gives boxes [N, 4], labels [N], scores [N] and masks
    [N, 1, H, W], probabilities over the whole image.

    Raises:
        DataError: not an ONNX file, or of other inputs and outputs.
        MissingExtraError: onnxruntime is not installed.
    """
    session = _open(path)
    names = _output_names(session, path)
    (image,) = session.get_inputs()
    height, width = image.shape[-2:]
    fixed = (width, height) if isinstance(height, int) and isinstance(width, int) else None

    def detect(rgb: UInt8[np.ndarray, "H W 3"]) -> Detections:
        part = rgb if fixed is None else cv2.resize(rgb, fixed, interpolation=cv2.INTER_AREA)
        planes = np.ascontiguousarray(part.transpose(2, 0, 1), dtype=np.float32) / 255.0
        fed = planes if len(image.shape) == 3 else planes[None]
        _, labels, scores, masks = session.run(names, {image.name: fed})
        return Detections(
            labels.astype(np.int64), scores, _at_size(masks[:, 0], rgb.shape[1], rgb.shape[0])
        )

    return Weights(detect, _categories(session))


def _open(path: Path) -> Any:
    try:
        import onnxruntime
    except ImportError as error:
        raise MissingExtraError("onnxruntime", "segmenter") from error
    try:
        return onnxruntime.InferenceSession(str(path), providers=["CPUExecutionProvider"])
    except Exception as error:  # onnxruntime's own exceptions have no common base
        raise DataError(
            path, f"ONNX Runtime cannot open it ({error})", "Export Mask R-CNN again"
        ) from error


def _output_names(session: Any, path: Path) -> list[str]:
    names = [output.name for output in session.get_outputs()]
    inputs = session.get_inputs()
    if len(inputs) != 1 or len(inputs[0].shape) not in (3, 4) or len(names) < len(OUTPUTS):
        raise DataError(
            path,
            f"it has {len(inputs)} inputs and the outputs {', '.join(names)}",
            f"Mask R-CNN has one image as input and gives {', '.join(OUTPUTS)}",
        )
    return list(OUTPUTS) if set(OUTPUTS) <= set(names) else names[: len(OUTPUTS)]


def _categories(session: Any) -> tuple[str, ...]:
    stored = session.get_modelmeta().custom_metadata_map.get(CATEGORIES_KEY)
    return tuple(json.loads(stored)) if stored else CATEGORIES


def _at_size(masks: np.ndarray, width: int, height: int) -> np.ndarray:
    """Masks of the image that was fed, at the size of the frame."""
    if masks.shape[1:] == (height, width):
        return masks
    resized = [cv2.resize(mask, (width, height)) for mask in masks]
    return np.stack(resized) if resized else np.zeros((0, height, width), np.float32)
