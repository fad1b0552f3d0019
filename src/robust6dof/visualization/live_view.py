"""A track live in a browser page, on this machine only (extra `viewer`)."""

from __future__ import annotations

from types import ModuleType, TracebackType
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from robust6dof.errors import MissingExtraError
from robust6dof.frames import TrackState
from robust6dof.geometry.boxes import box_corners
from robust6dof.visualization.overlay import AXIS_COLORS, BOX_EDGES, YELLOW, axis_segments
from robust6dof.visualization.track_view import (
    KEYPOINT_COLOR,
    STATE_COLORS,
    TrackView,
    draw_track_view,
)

HOST = "127.0.0.1"
"""Nobody but this machine sees the page."""

_CAMERA_FOV = np.deg2rad(40.0)


class LiveView:
    """Serve a page that shows each new view; use it as a context manager.

    Args:
        port: the page's; the next free one where it is taken.

    Raises:
        MissingExtraError: viser is not installed.
    """

    def __init__(self, port: int = 8080) -> None:
        self._viser = _import_viser()
        self._server = self._viser.ViserServer(host=HOST, port=port, verbose=False)
        self._server.gui.configure_theme(control_width="large")
        self._server.gui.main_panel.dock_right()
        self._server.gui.set_panel_label("robust6dof")
        self._server.scene.set_up_direction("-y")
        self._confidence: list[float] = []
        self._states: list[TrackState] = []
        self._panel: _Panel | None = None

    @property
    def url(self) -> str:
        """Address of the page."""
        return f"http://{HOST}:{self._server.get_port()}"

    def show(self, view: TrackView) -> None:
        """Bring the page up to this frame."""
        self._confidence.append(view.track.confidence)
        self._states.append(view.track.state)
        first = self._panel is None
        with self._server.atomic():
            if self._panel is None:
                self._panel = _Panel(self._viser, self._server, view)
            self._panel.show(view, self._confidence, self._states)
            self._show_space(view)
        if first:
            self._look_at_object(view)

    def wait(self) -> None:
        """Keep the page up until interrupted (Ctrl-C)."""
        try:
            self._server.sleep_forever()
        except KeyboardInterrupt:
            return

    def close(self) -> None:
        """Take the page down."""
        self._server.stop()

    def __enter__(self) -> LiveView:
        return self

    def __exit__(
        self,
        error_type: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()

    def _show_space(self, view: TrackView) -> None:
        """Cloud, keypoints, box and axes, camera; a new node takes the old one's place."""
        scene, track, frame = self._server.scene, view.track, view.frame
        scene.add_point_cloud(
            "/cloud", view.cloud_cam, view.cloud_rgb, point_size=0.002, point_shape="circle"
        )
        scene.add_point_cloud(
            "/keypoints", view.keypoints_cam, KEYPOINT_COLOR, point_size=0.005, point_shape="circle"
        )
        scene.add_camera_frustum(
            "/camera",
            fov=2 * float(np.arctan(frame.height / (2 * frame.K[1, 1]))),
            aspect=frame.width / frame.height,
            scale=0.08,
        )
        if not (np.isfinite(track.T_cam_obj).all() and np.isfinite(track.extents).all()):
            return
        corners = box_corners(track.T_cam_obj, track.extents)
        edges = np.array([corners[list(edge)] for edge in BOX_EDGES])
        scene.add_line_segments("/box", edges, YELLOW, thickness=0.0015)
        axes = axis_segments(track.T_cam_obj, track.extents)
        colors = np.repeat(np.array(AXIS_COLORS)[:, None], 2, axis=1)
        scene.add_line_segments("/axes", axes, colors, thickness=0.003)

    def _look_at_object(self, view: TrackView) -> None:
        """The first camera of every visitor: from behind the real one and a little above."""
        centre = view.track.T_cam_obj[:3, 3]
        if not np.isfinite(centre).all():
            return
        away = Rotation.from_euler("yx", [20.0, -15.0], degrees=True).apply([0.0, 0.0, -1.0])
        camera = self._server.initial_camera
        camera.position = tuple(centre + 4.0 * view.track.scale * away)
        camera.look_at = tuple(centre)
        camera.fov = float(_CAMERA_FOV)


class _Panel:
    """The column beside the 3D scene: image, numbers, confidence and state over time."""

    def __init__(self, viser: ModuleType, server: Any, view: TrackView) -> None:
        gui = server.gui
        self._image = gui.add_image(draw_track_view(view), format="jpeg")
        self._text = gui.add_markdown("")
        colors = [f"rgb{color}" for color in STATE_COLORS.values()]
        series = [
            viser.uplot.Series(label=str(state), stroke=color, width=2, spanGaps=False)
            for state, color in zip(STATE_COLORS, colors, strict=True)
        ]
        self._plot = gui.add_uplot(
            _curves([0.0], [view.track.state]),
            (viser.uplot.Series(label="frame"), *series),
            title="confidence, coloured by state",
            scales={
                "x": viser.uplot.Scale(time=False, auto=True),
                "y": viser.uplot.Scale(range=(0.0, 1.0)),
            },
            aspect=1.9,
        )

    def show(self, view: TrackView, confidence: list[float], states: list[TrackState]) -> None:
        track = view.track
        self._image.image = draw_track_view(view)
        x, y, z = 100 * track.T_cam_obj[:3, 3]
        width, height, depth = 100 * track.extents
        matched = f"; {len(view.matches_px)} matches" if len(view.matches_px) else ""
        self._text.content = (
            f"**{track.state}** with confidence {track.confidence:.2f}, frame {len(states)} "
            f"({view.frame.name}), {view.ms:.0f} ms\n\n"
            f"at {x:.1f}, {y:.1f}, {z:.1f} cm; box {width:.1f} × {height:.1f} × {depth:.1f} cm"
            f"{matched}"
        )
        self._plot.data = _curves(confidence, states)


def _curves(confidence: list[float], states: list[TrackState]) -> tuple[np.ndarray, ...]:
    """Frame numbers, then for each state the confidence while in it (NaN elsewhere), joined."""
    values, kinds = np.asarray(confidence, dtype=float), np.array([str(state) for state in states])
    curves = []
    for state in STATE_COLORS:
        inside = kinds == state
        inside[:-1] |= inside[1:]  # the line into a state has its colour
        curves.append(np.where(inside, values, np.nan))
    return (np.arange(1.0, len(values) + 1), *curves)


def _import_viser() -> ModuleType:
    try:
        import viser
        import viser.uplot
    except ImportError as error:
        raise MissingExtraError("viser", "viewer") from error
    return viser
