"""A track as a rerun timeline: `rerun FILE.rrd` plays it (extra `rerun`)."""

from __future__ import annotations

from pathlib import Path
from types import ModuleType, TracebackType

import numpy as np

from robust6dof.errors import MissingExtraError
from robust6dof.frames import TrackState
from robust6dof.visualization.overlay import (
    AXIS_COLORS,
    YELLOW,
    axis_lines,
    axis_segments,
    box_edges,
)
from robust6dof.visualization.track_view import (
    KEYPOINT_COLOR,
    MATCH_COLOR,
    STATE_COLORS,
    TrackView,
    visible_pixels,
)

_JPEG_QUALITY = 85


class RerunRecorder:
    """Write every frame's view to one .rrd file; use it as a context manager.

    In the file: `camera/…` the image with what is drawn over it; `world/…` the same in 3D, camera
    axes; `confidence`, `ms` and `state` over time. Timelines: `frame`, and `time` where the
    recording has stamps.

    Raises:
        MissingExtraError: rerun is not installed.
    """

    def __init__(self, path: str | Path) -> None:
        self._rr = _import_rerun()
        Path(path).parent.mkdir(parents=True, exist_ok=True)
        self._stream = self._rr.RecordingStream("robust6dof_track")
        self._stream.save(path, default_blueprint=_blueprint())
        self._frames = 0
        self._log_static()

    def write(self, view: TrackView) -> None:
        """Append one frame."""
        self._stream.set_time("frame", sequence=self._frames)
        if view.frame.stamp is not None:
            self._stream.set_time("time", duration=view.frame.stamp)
        self._log_image(view)
        self._log_world(view)
        rr, track = self._rr, view.track
        self._stream.log("confidence", rr.Scalars(track.confidence))
        self._stream.log("ms", rr.Scalars(view.ms))
        self._stream.log("state", rr.StateChange(state=str(track.state)))
        self._frames += 1

    def close(self) -> None:
        """Write what is still in flight and close the file."""
        self._stream.flush()
        self._stream.disconnect()

    def __enter__(self) -> RerunRecorder:
        return self

    def __exit__(
        self,
        error_type: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    def _log_static(self) -> None:
        rr = self._rr
        self._stream.log("world", rr.ViewCoordinates.RDF, static=True)
        states = list(TrackState)
        configuration = rr.StateConfiguration(
            values=[str(state) for state in states],
            colors=[STATE_COLORS[state] for state in states],
        )
        self._stream.log("state", configuration, static=True)

    def _log_image(self, view: TrackView) -> None:
        rr, track, K = self._rr, view.track, view.frame.K
        picture = rr.Image(np.ascontiguousarray(view.image)).compress(jpeg_quality=_JPEG_QUALITY)
        self._stream.log("camera/image", picture)
        box = box_edges(K, track.T_cam_obj, track.extents)
        self._stream.log("camera/box", rr.LineStrips2D(box, colors=YELLOW, radii=1.0))
        axes = zip(axis_lines(K, track.T_cam_obj, track.extents), AXIS_COLORS, strict=True)
        seen = [(line, color) for line, color in axes if line is not None]
        lines, colors = [line for line, _ in seen], [color for _, color in seen]
        self._stream.log("camera/axes", rr.LineStrips2D(lines, colors=colors, radii=1.5))
        keypoints = visible_pixels(view.keypoints_cam, K)
        self._stream.log(
            "camera/keypoints", rr.Points2D(keypoints, colors=KEYPOINT_COLOR, radii=2.0)
        )
        self._stream.log(
            "camera/matches", rr.LineStrips2D(view.matches_px, colors=MATCH_COLOR, radii=0.5)
        )

    def _log_world(self, view: TrackView) -> None:
        rr, frame, track = self._rr, view.frame, view.track
        size = [frame.width, frame.height]
        self._stream.log(
            "world/camera",
            rr.Pinhole(image_from_camera=frame.K, resolution=size, image_plane_distance=0.1),
        )
        cloud = rr.Points3D(view.cloud_cam, colors=view.cloud_rgb, radii=0.001)
        self._stream.log("world/cloud", cloud)
        keypoints = rr.Points3D(view.keypoints_cam, colors=KEYPOINT_COLOR, radii=0.003)
        self._stream.log("world/keypoints", keypoints)
        if not np.isfinite(track.T_cam_obj).all():
            return
        T_cam_obj = rr.Transform3D(
            translation=track.T_cam_obj[:3, 3], mat3x3=track.T_cam_obj[:3, :3]
        )
        self._stream.log("world/object", T_cam_obj)
        self._stream.log("world/object/box", rr.Boxes3D(sizes=[track.extents], colors=YELLOW))
        axes = axis_segments(np.eye(4), track.extents)[:, 1]
        self._stream.log("world/object/axes", rr.Arrows3D(vectors=axes, colors=AXIS_COLORS))


def _import_rerun() -> ModuleType:
    try:
        import rerun
    except ImportError as error:
        raise MissingExtraError("rerun", "rerun") from error
    return rerun


def _blueprint():
    """How the viewer lays it out: image and space side by side, confidence and state below."""
    import rerun.blueprint as rrb

    return rrb.Blueprint(
        rrb.Vertical(
            rrb.Horizontal(
                rrb.Spatial2DView(origin="camera", name="image"),
                rrb.Spatial3DView(origin="world", name="camera space"),
            ),
            rrb.TimeSeriesView(
                origin="confidence", name="confidence", axis_y=rrb.ScalarAxis(range=(0.0, 1.05))
            ),
            rrb.StateTimelineView(origin="state", name="state"),
            row_shares=[4, 1.2, 0.8],
        ),
        collapse_panels=True,
    )
