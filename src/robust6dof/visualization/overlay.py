"""A pose drawn over the image: the object's box and its axes."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from robust6dof.frames import RgbdFrame
from robust6dof.geometry.boxes import box_corners
from robust6dof.geometry.camera import project
from robust6dof.geometry.transforms import transform_points

YELLOW = (255, 210, 40)
"""Predictions, as in the paper's figures (RGB)."""
GREEN = (60, 220, 90)
"""Ground truth, as in the paper's figures (RGB)."""
AXIS_COLORS = ((235, 60, 60), (70, 200, 70), (70, 110, 245))
"""x red, y green, z blue (RGB)."""

_NEAR = 0.02
Segment = Float[np.ndarray, "2 2"]
"""Two pixels (x, y)."""
BOX_EDGES = [(a, b) for a in range(8) for b in range(a + 1, 8) if a ^ b in (1, 2, 4)]
"""Corners (as `geometry.boxes.box_corners` orders them) at the ends of each edge."""


def draw_box_and_axes(
    rgb: UInt8[np.ndarray, "H W 3"],
    K: Float[np.ndarray, "3 3"],
    T_cam_obj: Float[np.ndarray, "4 4"],
    extents: Float[np.ndarray, "3"],
    color: tuple[int, int, int] = YELLOW,
    *,
    axes: bool = True,
    thickness: int = 2,
) -> UInt8[np.ndarray, "H W 3"]:
    """Return a copy of the image with the object's box in `color` and its axes (x, y, z = r, g, b).

    Parts behind the camera are cut off; a pose that is not finite draws nothing.

    Args:
        rgb: image.
        K: pinhole intrinsics [px].
        T_cam_obj: rigid transform, object centred on its box.
        extents: side lengths of the box [m].
        color: of the box, RGB.
        axes: draw the axes too.
        thickness: of the lines [px].
    """
    image = np.ascontiguousarray(rgb).copy()
    for segment in box_edges(K, T_cam_obj, extents):
        _draw_line(image, segment, color, thickness)
    if axes:
        for segment, axis_color in zip(axis_lines(K, T_cam_obj, extents), AXIS_COLORS, strict=True):
            _draw_line(image, segment, axis_color, thickness + 1)
    return image


def box_edges(
    K: Float[np.ndarray, "3 3"],
    T_cam_obj: Float[np.ndarray, "4 4"],
    extents: Float[np.ndarray, "3"],
) -> list[Segment]:
    """The box's edges in the image, cut off behind the camera; none if anything is not finite."""
    corners_cam = box_corners(T_cam_obj, extents)
    edges = [_project_segment(K, corners_cam[a], corners_cam[b]) for a, b in BOX_EDGES]
    return [edge for edge in edges if edge is not None]


def axis_lines(
    K: Float[np.ndarray, "3 3"],
    T_cam_obj: Float[np.ndarray, "4 4"],
    extents: Float[np.ndarray, "3"],
) -> list[Segment | None]:
    """The axes of `axis_segments` in the image; None for one behind the camera or not finite."""
    return [_project_segment(K, *ends) for ends in axis_segments(T_cam_obj, extents)]


def axis_segments(
    T_cam_obj: Float[np.ndarray, "4 4"], extents: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "3 2 3"]:
    """Both ends of the object's x, y and z axis: from its centre to a little beyond its box.

    Those of a flat object reach farther, or its short axis would hardly show.
    """
    lengths = 0.75 * np.maximum(extents, 0.3 * extents.max())
    tips_obj = np.stack([np.zeros((3, 3)), np.diag(lengths)], axis=1)
    return transform_points(T_cam_obj, tips_obj)


def draw_label(
    rgb: UInt8[np.ndarray, "H W 3"], text: str, row: int = 0
) -> UInt8[np.ndarray, "H W 3"]:
    """Return a copy with one line of text on a dark band at the top left; `row` counts down."""
    image = np.ascontiguousarray(rgb).copy()
    scale = image.shape[0] / 960.0
    (width, height), baseline = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, scale, 1)
    step = height + baseline + 6
    top = row * step
    image[top : top + step, : width + 12] //= 3
    origin = (6, top + height + 4)
    cv2.putText(
        image, text, origin, cv2.FONT_HERSHEY_SIMPLEX, scale, (255, 255, 255), 1, cv2.LINE_AA
    )
    return image


def frame_image(frame: RgbdFrame) -> UInt8[np.ndarray, "H W 3"]:
    """A frame's colour, or its depth in colours where it has none."""
    return frame.rgb if frame.has_color else colorize_depth(frame.depth)


def colorize_depth(depth: np.ndarray, near: float = 0.3, far: float = 2.0) -> np.ndarray:
    """Depth [m] as an RGB picture: near is warm, far is cold, invalid is black."""
    level = np.clip((far - np.nan_to_num(depth)) / (far - near), 0.0, 1.0)
    picture = cv2.applyColorMap((level * 255).astype(np.uint8), cv2.COLORMAP_TURBO)
    picture = cv2.cvtColor(picture, cv2.COLOR_BGR2RGB)
    picture[~(np.isfinite(depth) & (depth > 0))] = 0
    return picture


def _draw_line(
    image: np.ndarray, segment: Segment | None, color: tuple[int, int, int], thickness: int
) -> None:
    if segment is not None:
        (x0, y0), (x1, y1) = np.rint(segment).astype(int)
        cv2.line(image, (int(x0), int(y0)), (int(x1), int(y1)), color, thickness, cv2.LINE_AA)


def _project_segment(K: np.ndarray, start_cam: np.ndarray, end_cam: np.ndarray) -> Segment | None:
    if not (np.isfinite(start_cam).all() and np.isfinite(end_cam).all()):
        return None
    clipped = _clip_to_near_plane(start_cam, end_cam)
    if clipped is None:
        return None
    ends = project(np.stack(clipped), K)
    # OpenCV's lines take 16-bit-like ranges; far outside the image nothing is visible anyway.
    return ends if np.abs(ends).max() <= 1e5 else None


def _clip_to_near_plane(
    start_cam: np.ndarray, end_cam: np.ndarray
) -> tuple[np.ndarray, np.ndarray] | None:
    if start_cam[2] < _NEAR and end_cam[2] < _NEAR:
        return None
    if start_cam[2] >= _NEAR and end_cam[2] >= _NEAR:
        return start_cam, end_cam
    crossing = start_cam + (end_cam - start_cam) * (
        (_NEAR - start_cam[2]) / (end_cam[2] - start_cam[2])
    )
    return (crossing, end_cam) if start_cam[2] < _NEAR else (start_cam, crossing)
