"""The truth that CAPTRA scores against: NOCS poses fitted anew to coordinate maps and depth.

As its get_gt_poses.py does (kernel, threshold and number of hypotheses are its own): the border of
an object's mask is cut off, similarities are fitted to 64 triples of pixels, the one with the most
pixels within 1 mm is fitted again to these. Its back-projection mirrors the rows without mirroring
the principal point, which shifts its whole camera by 8 pixels; that is left out, since trackers
here see the true camera.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

from robust6dof.data.dataset import Dataset, DatasetSequence, ObjectTruth
from robust6dof.data.nocs import BACKGROUND, NocsSequence
from robust6dof.frames import RgbdFrame
from robust6dof.geometry.alignment import fit_similarity
from robust6dof.geometry.camera import backproject

BORDER_PX = 2
INLIER_M = 1e-3
HYPOTHESES = 64
FEWEST_PIXELS = 3


def with_refitted_truth(dataset: Dataset) -> Dataset:
    """NOCS with the truth fitted anew; other data sets, which have no coordinate maps, as is."""
    sequences = tuple(
        RefittedNocs(sequence, sequence.name, sequence.frame_names)
        if isinstance(sequence, NocsSequence)
        else sequence
        for sequence in dataset.sequences
    )
    return replace(dataset, sequences=sequences)


@dataclass(frozen=True, eq=False)
class RefittedNocs(DatasetSequence):
    """A NOCS scene whose truth is fitted to its coordinate maps."""

    whole: NocsSequence
    name: str
    frame_names: tuple[str, ...]

    def frame(self, index: int) -> RgbdFrame:
        return self.whole.frame(index)

    def truth(self, index: int) -> tuple[ObjectTruth, ...]:
        """Objects with fewer than three pixels, or no fit, are left out as CAPTRA leaves them.

        Raises:
            DataError: no `_coord.png`, or what `NocsSequence.truth` raises.
        """
        truths = self.whole.truth(index)
        return tuple(self._refitted(index, truths)) if truths else ()

    def missing(self, index: int) -> tuple[str, ...]:
        return self.whole.missing(index)

    def _refitted(self, index: int, truths: tuple[ObjectTruth, ...]) -> Iterator[ObjectTruth]:
        frame = self.whole.frame(index)
        canonical = self.whole.coordinates(index) - 0.5
        ids = without_border(self.whole.instance_ids(index))
        for truth in truths:
            points_cam, pixels = backproject(frame.depth, frame.K, ids == truth.instance_id)
            if len(points_cam) < FEWEST_PIXELS:
                continue
            x, y = pixels.astype(int).T
            fit = fit_truth(canonical[y, x], points_cam)
            if fit is not None:
                T_cam_obj, scale = fit
                yield replace(truth, T_cam_obj=T_cam_obj, extents=_scaled(truth.extents, scale))


def without_border(ids: UInt8[np.ndarray, "H W"]) -> UInt8[np.ndarray, "H W"]:
    """Background grown over the objects: two pixels up and left of each, one down and right."""
    kernel = np.ones((2 * BORDER_PX, 2 * BORDER_PX), np.uint8)
    anchor = (BORDER_PX - 1, BORDER_PX - 1)
    grown: Bool[np.ndarray, "H W"] = (
        cv2.dilate((ids == BACKGROUND).astype(np.uint8), kernel, anchor=anchor) > 0
    )
    return np.where(grown, np.uint8(BACKGROUND), ids)


def fit_truth(
    canonical: Float[np.ndarray, "P 3"], points_cam: Float[np.ndarray, "P 3"]
) -> tuple[Float[np.ndarray, "4 4"], float] | None:
    """T_cam_obj and NOCS scale [m] from pixels' centred NOCS coordinates; None where none fits.

    The triples are drawn from a fixed seed: a frame has one truth.
    """
    rng = np.random.default_rng(0)
    triples = np.array([rng.choice(len(canonical), 3, replace=False) for _ in range(HYPOTHESES)])
    T, scale = fit_similarity(canonical[triples], points_cam[triples])
    near = np.array(
        [_residuals(*one, canonical, points_cam) < INLIER_M for one in zip(T, scale, strict=True)]
    )
    inliers = near[near.sum(axis=1).argmax()]
    if inliers.sum() < FEWEST_PIXELS:
        return None
    T_cam_obj, best = fit_similarity(canonical[inliers], points_cam[inliers])
    return T_cam_obj, float(best)


def _residuals(
    T: np.ndarray, scale: float, canonical: np.ndarray, points_cam: np.ndarray
) -> Float[np.ndarray, "P"]:
    return np.linalg.norm(scale * canonical @ T[:3, :3].T + T[:3, 3] - points_cam, axis=1)


def _scaled(extents: np.ndarray | None, scale: float) -> Float[np.ndarray, "3"] | None:
    """The box of the fitted diagonal."""
    return None if extents is None else extents * scale / np.linalg.norm(extents)
