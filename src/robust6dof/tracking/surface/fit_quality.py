"""Does the depth image agree that the object is there? The evidence behind the ICP's confidence."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from robust6dof.frames import RgbdFrame
from robust6dof.geometry.camera import project
from robust6dof.geometry.transforms import transform_points
from robust6dof.tracking.region import NEAREST_M, depth_noise
from robust6dof.tracking.surface.cloud import Cloud


@dataclass(frozen=True)
class FitQuality:
    """Shares of the model's surface that should be in view."""

    supported: float
    """The depth image shows a surface there."""
    contradicted: float
    """The depth image sees through it: the object is not there."""
    occluded: float
    """Something nearer hides it."""
    visible_points: int
    """Model points in the image that face the camera and that the model itself does not hide."""
    in_image: float
    """Share of the facing model points that fall inside the image."""
    residual: float
    """Median |depth difference| of the supported points over the largest allowed, 0 to 1."""
    color_gap: float = 0.0
    """Median difference in colour of the supported points, 0 to 1; 0 where the model has none."""

    @property
    def agreement(self) -> float:
        """Supported share of what can be decided, 0 to 1; 0 where nothing can be decided."""
        decided = self.supported + self.contradicted
        return self.supported / decided if decided > 0 else 0.0

    @property
    def confidence(self) -> float:
        """0 to 1: of the shape, faded out where the colours are others."""
        alike = 1.0 - float(np.clip((self.color_gap - 0.06) / 0.1, 0.0, 1.0))
        return alike * self.shape_confidence

    @property
    def shape_confidence(self) -> float:
        """0 to 1: agreement, faded out where little of the object is seen or the fit is loose."""
        seen = min(1.0, self.supported * self.in_image / 0.35)
        enough = min(1.0, self.supported * self.visible_points / 40.0)
        tight = 1.0 - max(0.0, self.residual - 0.4)
        return float(np.clip(self.agreement**2 * seen * enough * tight, 0.0, 1.0))


NOTHING_SEEN = FitQuality(0.0, 0.0, 0.0, 0, 0.0, 0.0)


def assess(
    frame: RgbdFrame,
    T_cam_obj: Float[np.ndarray, "4 4"],
    cloud: Cloud,
    *,
    spacing: float,
) -> tuple[FitQuality, Bool[np.ndarray, "M"]]:
    """Compare the model at `T_cam_obj` with the image, in depth and colour.

    Args:
        cloud: the model's surface in the object frame [m], M points.
        spacing: distance between neighbouring model points [m]: it sets what counts as agreement
            (besides the sensor's noise), along and across the line of sight.

    Returns:
        the shares, and which points the image sees through.
    """
    refuted = np.zeros(len(cloud), dtype=bool)
    points_cam = transform_points(T_cam_obj, cloud.points)
    normals_cam = cloud.normals @ T_cam_obj[:3, :3].T
    distance = np.linalg.norm(points_cam, axis=-1)
    cosine = -np.sum(normals_cam * points_cam, axis=-1) / np.maximum(distance, 1e-9)
    facing = np.nonzero((cosine > 0.3) & (points_cam[:, 2] > NEAREST_M))[0]
    if not len(facing):
        return NOTHING_SEEN, refuted
    z = points_cam[facing, 2]
    pixels = np.rint(project(points_cam[facing], frame.K)).astype(int)
    inside = ((pixels >= 0) & (pixels < [frame.width, frame.height])).all(axis=-1)
    seen = inside & _not_hidden(z, pixels, spacing, frame.K[0, 0])
    if not seen.any():
        return NOTHING_SEEN, refuted
    difference = _nearest_difference(frame, z[seen], pixels[seen], spacing)
    limit = 1.5 * spacing + 2.0 * depth_noise(z[seen])
    refuted[facing[seen]] = difference >= limit
    gap = _color_gap(frame, cloud.color[facing[seen]], pixels[seen])
    return _shares(difference, limit, gap, float(inside.mean())), refuted


def _color_gap(
    frame: RgbdFrame, color: Float[np.ndarray, "P 3"], pixels: Int[np.ndarray, "P 2"]
) -> Float[np.ndarray, "P"]:
    """Mean |difference| of the channels, 0 to 1; NaN where the model has no colour. A black image
    is dark, not unknown."""
    x, y = pixels.T
    return np.abs(frame.rgb[y, x] - color).mean(axis=-1) / 255.0


def _shares(
    difference: np.ndarray, limit: np.ndarray, gap: np.ndarray, in_image: float
) -> FitQuality:
    supported = np.abs(difference) < limit
    gaps = gap[supported & ~np.isnan(gap)]
    relative = np.abs(difference[supported]) / limit[supported]
    return FitQuality(
        supported=float(supported.mean()),
        contradicted=float((difference >= limit).mean()),
        occluded=float((difference <= -limit).mean()),
        visible_points=len(difference),
        in_image=in_image,
        residual=float(np.median(relative)) if len(relative) else 1.0,
        color_gap=float(np.median(gaps)) if len(gaps) else 0.0,
    )


def _nearest_difference(
    frame: RgbdFrame, z: Float[np.ndarray, "P"], pixels: np.ndarray, spacing: float
) -> Float[np.ndarray, "P"]:
    """Observed minus predicted depth [m] at the pixel or one model spacing beside it, whichever
    agrees best; NaN without depth. Sensors fatten silhouettes by about as much."""
    reach = np.clip(np.rint(spacing * frame.K[0, 0] / z), 1, 8).astype(int)[:, None]
    difference = np.full(len(z), np.nan)
    for offset in ([0, 0], [1, 0], [-1, 0], [0, 1], [0, -1]):
        x, y = np.clip(pixels + reach * offset, 0, [frame.width - 1, frame.height - 1]).T
        observed = frame.depth[y, x].astype(np.float64)
        there = np.where(np.isfinite(observed) & (observed > NEAREST_M), observed, np.nan) - z
        better = ~(np.abs(there) >= np.abs(difference)) & ~np.isnan(there)
        difference = np.where(better, there, difference)
    return difference


def _not_hidden(
    z: Float[np.ndarray, "P"], pixels: np.ndarray, spacing: float, focal: float
) -> Bool[np.ndarray, "P"]:
    """Coarse z-buffer: cells two model spacings wide at the object's distance."""
    cell = max(2.0, 2.0 * spacing * focal / float(np.median(z)))
    cells = np.floor(pixels / cell).astype(int)
    cells -= cells.min(axis=0)
    index = cells[:, 0] * (int(cells[:, 1].max()) + 1) + cells[:, 1]
    nearest = np.full(int(index.max()) + 1, np.inf)
    np.minimum.at(nearest, index, z)
    return z < nearest[index] + 4.0 * spacing
