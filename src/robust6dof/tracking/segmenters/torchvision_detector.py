"""Mask R-CNN through torchvision, where that loads (extra `segmenter-training`)."""

from __future__ import annotations

from pathlib import Path
from pickle import UnpicklingError
from types import ModuleType
from typing import Any

import numpy as np
import torch
from jaxtyping import UInt8

from robust6dof.errors import DataError, MissingExtraError
from robust6dof.tracking.segmenters.mask_rcnn import Detections, Weights

EXTRA = "segmenter-training"

_UNREADABLE = (KeyError, TypeError, ValueError, RuntimeError, OSError, EOFError, UnpicklingError)


def import_torchvision() -> ModuleType:
    """torchvision with its detection models.

    Raises:
        MissingExtraError: it is not installed, or was built for another torch (its operators are
            then missing: wheels of PyPI want the CUDA build of torch, so beside the CPU build both
            must come from PyTorch's CPU index).
    """
    try:
        import torchvision  # pyright: ignore[reportMissingImports]
        import torchvision.models.detection  # pyright: ignore[reportMissingImports]

        torch.ops.torchvision.nms  # noqa: B018 — absent where the wheel does not fit torch
    except (ImportError, RuntimeError, AttributeError, OSError) as error:
        wanted = f"torchvision that loads beside torch {torch.__version__}"
        raise MissingExtraError(wanted, EXTRA) from error
    return torchvision


def make_mask_rcnn(classes: int, size_px: tuple[int, int] = (480, 640)) -> Any:
    """ResNet-50 with a feature pyramid, the paper's kind, untrained.

    Args:
        classes: the background included.
        size_px: shorter and longer side that images are scaled to.

    Raises:
        MissingExtraError: see `import_torchvision`.
    """
    detection = import_torchvision().models.detection
    return detection.maskrcnn_resnet50_fpn(
        weights=None,
        weights_backbone=None,
        num_classes=classes,
        min_size=size_px[0],
        max_size=size_px[1],
    )


def load_torchvision(path: Path) -> Weights:
    """Open what `robust6dof train-segmenter` wrote: `categories`, `size_px` and `state_dict`.

    Raises:
        DataError: another kind of file.
        MissingExtraError: see `import_torchvision`.
    """
    import_torchvision()
    try:
        stored = torch.load(path, map_location="cpu", weights_only=True)
        categories = tuple(stored["categories"])
        shorter, longer = stored["size_px"]
        model = make_mask_rcnn(1 + len(categories), (shorter, longer))
        model.load_state_dict(stored["state_dict"])
    except _UNREADABLE as error:
        raise DataError(
            path, f"not weights of Mask R-CNN ({error})", "Train with robust6dof train-segmenter"
        ) from error
    model.eval()

    def detect(rgb: UInt8[np.ndarray, "H W 3"]) -> Detections:
        image = torch.from_numpy(np.ascontiguousarray(rgb.transpose(2, 0, 1))).float() / 255.0
        with torch.inference_mode():
            found = model([image])[0]
        labels, scores, masks = (found[name].numpy() for name in ("labels", "scores", "masks"))
        return Detections(labels, scores, masks[:, 0])

    return Weights(detect, categories)
