"""What is shown of one object in one frame: points, keypoints, matches with the last view."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import torch
from jaxtyping import Float, UInt8

from robust6dof.frames import RgbdFrame, Track, TrackState
from robust6dof.geometry.camera import backproject, project
from robust6dof.geometry.transforms import invert_transform, transform_points
from robust6dof.network.inputs import ViewFeatures
from robust6dof.network.matching import select_pairs
from robust6dof.network.robust6dof_net import Robust6DofNet
from robust6dof.tracking.keyframes import Keyframe
from robust6dof.tracking.segmentation import propagated_mask
from robust6dof.visualization.overlay import draw_box_and_axes, draw_label, frame_image

STATE_COLORS: dict[TrackState, tuple[int, int, int]] = {
    TrackState.TRACKING: (70, 190, 90),
    TrackState.UNCERTAIN: (240, 180, 40),
    TrackState.LOST: (225, 65, 60),
    TrackState.RECOVERING: (80, 130, 245),
}
"""RGB."""
KEYPOINT_COLOR = (0, 229, 255)
MATCH_COLOR = (255, 80, 220)

_MARGIN_M = 0.05
_MOST_POINTS = 20_000


@dataclass(frozen=True, eq=False)
class TrackView:
    """One object in one frame, camera axes."""

    frame: RgbdFrame
    track: Track
    ms: float
    """That the tracker took."""
    cloud_cam: Float[np.ndarray, "N 3"]
    """Points in and around the object's box [m]."""
    cloud_rgb: UInt8[np.ndarray, "N 3"]
    keypoints_cam: Float[np.ndarray, "K 3"]
    """Keypoints of the network's last look, moved along with the object; none without network."""
    matches_px: Float[np.ndarray, "M 2 2"]
    """Where each matched keypoint was at the last look but one, and where it is [px]; none in a
    frame at which the network did not look."""

    @property
    def image(self) -> UInt8[np.ndarray, "H W 3"]:
        """Colour, or coloured depth where there is none."""
        return frame_image(self.frame)


def make_track_view(
    frame: RgbdFrame,
    track: Track,
    before: Track | None = None,
    net: Robust6DofNet | None = None,
    ms: float = 0.0,
) -> TrackView:
    """Collect what a track's own memory and its frame hold.

    Args:
        frame: the image.
        track: the object in it.
        before: the track one step earlier, for the matches.
        net: of the tracker; matches the keypoints of the two looks.
        ms: that the tracker took.
    """
    points, colors = _cloud(frame, track)
    now, then = _last_look(track), None if before is None else _last_look(before)
    keypoints, matches = np.empty((0, 3)), np.empty((0, 2, 2))
    if now is not None:
        T_cam_then = track.T_cam_obj @ invert_transform(now.T_cam_obj)
        keypoints = transform_points(T_cam_then, _keypoints_cam(now.features))
        if then is not None and then is not now and net is not None:
            matches = _matches_px(net, then.features, now.features, frame.K)
    return TrackView(frame, track, ms, points, colors, keypoints, matches)


def draw_track_view(view: TrackView) -> UInt8[np.ndarray, "H W 3"]:
    """The image with box, axes, keypoints, matches, and a line of text."""
    track, K = view.track, view.frame.K
    image = draw_box_and_axes(view.image, K, track.T_cam_obj, track.extents)
    for start, end in np.rint(view.matches_px).astype(int).tolist():
        cv2.line(image, start, end, MATCH_COLOR, 1, cv2.LINE_AA)
    for pixel in np.rint(visible_pixels(view.keypoints_cam, K)).astype(int).tolist():
        cv2.circle(image, pixel, 2, KEYPOINT_COLOR, -1, cv2.LINE_AA)
    return draw_label(
        image, f"{view.frame.name}  {track.category}  {track.state}  {track.confidence:.2f}"
    )


def visible_pixels(
    points_cam: Float[np.ndarray, "N 3"], K: Float[np.ndarray, "3 3"]
) -> Float[np.ndarray, "M 2"]:
    """Pixels of the points that are finite and in front of the camera."""
    ahead = np.isfinite(points_cam).all(axis=-1) & (points_cam[:, 2] > 0.01)
    pixels = project(points_cam[ahead], K)
    return pixels[(np.abs(pixels) < 1e5).all(axis=-1)]


def _last_look(track: Track) -> Keyframe | None:
    """What the network's trackers keep of the last frame that they looked at."""
    last = getattr(track.memory, "last", None)
    return last if isinstance(last, Keyframe) else None


def _cloud(frame: RgbdFrame, track: Track) -> tuple[np.ndarray, np.ndarray]:
    mask = np.zeros(frame.depth.shape, dtype=bool)
    if np.isfinite(track.T_cam_obj).all() and np.isfinite(track.extents).all():
        mask = propagated_mask(frame, track.T_cam_obj, track.extents, margin_m=_MARGIN_M)
    points, pixels = backproject(frame.depth, frame.K, mask)
    step = max(1, len(points) // _MOST_POINTS)
    x, y = pixels[::step].astype(int).T
    colors = frame.rgb[y, x] if frame.has_color else np.full((len(x), 3), 190, np.uint8)
    return points[::step].astype(np.float64), colors


def _keypoints_cam(features: ViewFeatures) -> Float[np.ndarray, "K 3"]:
    return features.keypoints_cam[0].double().cpu().numpy()


@torch.inference_mode()
def _matches_px(
    net: Robust6DofNet, then: ViewFeatures, now: ViewFeatures, K: np.ndarray
) -> Float[np.ndarray, "M 2 2"]:
    """The pairs that the solver would be given, each keypoint projected into its own frame."""
    config = net.config
    pairs = select_pairs(
        then, now, net.match(then, now), config.match_threshold, config.fine_matching
    )
    old, new = (points.double().cpu().numpy() for points in (pairs.previous, pairs.current))
    seen = (old[:, 2] > 0.01) & (new[:, 2] > 0.01)
    return np.stack([project(old[seen], K), project(new[seen], K)], axis=1)
