"""Mask R-CNN, the paper's detector, behind the `Segmenter` protocol; weights by path."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int, UInt8

from robust6dof.errors import DataError, InputError
from robust6dof.frames import RgbdFrame
from robust6dof.tracking.region import valid_depth
from robust6dof.tracking.segmentation import Segment


@dataclass(frozen=True, eq=False)
class Detections:
    """What Mask R-CNN gives for one image, as torchvision defines it, the surest first."""

    labels: Int[np.ndarray, "N"]
    """Class numbers; 0 would be the background."""
    scores: Float[np.ndarray, "N"]
    masks: Float[np.ndarray, "N H W"]
    """Probability of each pixel of the whole image."""


Detector = Callable[[UInt8[np.ndarray, "H W 3"]], Detections]
"""RGB image → detections."""


@dataclass(frozen=True, eq=False)
class Weights:
    """A detector and what its class numbers mean."""

    detect: Detector
    categories: tuple[str, ...]
    """Of class 1, 2, …"""


@dataclass(frozen=True, eq=False)
class MaskRcnn:
    """Objects of one category, by their colour alone; those without depth are left out."""

    weights: Weights
    category: str
    least_score: float = 0.5
    """Detections below are not believed."""
    mask_threshold: float = 0.5
    least_depth_pixels: int = 30
    """With fewer valid depth pixels a mask is no use to the tracker."""

    @classmethod
    def from_file(cls, path: str | Path, category: str) -> MaskRcnn:
        """Through ONNX Runtime from FILE.onnx, through torchvision from FILE.pt.

        Raises:
            DataError: missing or unusable weights.
            InputError: they do not know the category.
            MissingExtraError: the library that runs them is not installed.
        """
        path = Path(path)
        if not path.is_file():
            raise DataError(
                path, "the weights are missing", "Train with robust6dof train-segmenter"
            )
        weights = _loader(path)(path)
        if category not in weights.categories:
            known = ", ".join(weights.categories)
            raise InputError(f"{path} knows no '{category}'; it knows: {known}")
        return cls(weights, category)

    def segment(self, frame: RgbdFrame) -> list[Segment]:
        """Masks of the category, the surest first; none in a recording without colour."""
        if not frame.has_color:
            return []
        found = self.weights.detect(frame.rgb)
        label = 1 + self.weights.categories.index(self.category)
        chosen = np.flatnonzero((found.labels == label) & (found.scores >= self.least_score))
        chosen = chosen[np.argsort(-found.scores[chosen], kind="stable")]
        masks = [found.masks[index] >= self.mask_threshold for index in chosen]
        free = valid_depth(frame)
        return [Segment(mask) for mask in masks if (mask & free).sum() >= self.least_depth_pixels]


def _loader(path: Path) -> Callable[[Path], Weights]:
    if path.suffix == ".onnx":
        from robust6dof.tracking.segmenters.onnx_detector import load_onnx

        return load_onnx
    if path.suffix == ".pt":
        from robust6dof.tracking.segmenters.torchvision_detector import load_torchvision

        return load_torchvision
    raise DataError(path, "weights of Mask R-CNN end in .onnx or .pt", "Export them to ONNX")
