"""A guidance run as a video: what the camera sees beside what a bystander sees."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from robust6dof.geometry.camera import project
from robust6dof.geometry.transforms import invert_transform, make_transform, transform_points
from robust6dof.rendering.rasteriser import render
from robust6dof.rendering.scene import Camera
from robust6dof.robot.aerial_manipulator import AerialManipulator
from robust6dof.simulation.episode import VEHICLE_ID, Episode
from robust6dof.simulation.guidance import GuidanceStep
from robust6dof.simulation.vehicle import QuadrotorParameters
from robust6dof.simulation.vehicle_look import VehicleLook
from robust6dof.visualization.overlay import GREEN, YELLOW, draw_box_and_axes, draw_label
from robust6dof.visualization.video import VideoWriter

_SIZE = (640, 480)
_FOCAL_PX = 530.0
_WHITE = (235, 235, 235)
_TRAIL = (255, 140, 40)


class GuidanceVideo:
    """An observer of `run_guidance` that writes an MP4. Use it as a context manager.

    Args:
        path: of the MP4.
        episode, manipulator: what is flown.
        T_cam_obj_goal: drawn into the onboard view as a thin white box.
        title: name of the pose source.
        truth: the poses are the truth: drawn green, as in the paper, instead of yellow.
        every: ticks from one video frame to the next.
        rate_hz: of the ticks.
    """

    def __init__(
        self,
        path: Path,
        episode: Episode,
        manipulator: AerialManipulator,
        T_cam_obj_goal: Float[np.ndarray, "4 4"],
        *,
        title: str,
        truth: bool,
        every: int = 2,
        rate_hz: float = 20.0,
    ) -> None:
        self._writer = VideoWriter(path, rate_hz / every)
        self._world, self._every = episode.world, every
        self._goal, self._title = T_cam_obj_goal, title
        self._color = GREEN if truth else YELLOW
        self._look = VehicleLook.build(manipulator, QuadrotorParameters())
        self._bystander = bystander_camera(episode)
        self._trail: list[Float[np.ndarray, "3"]] = []
        self._waiting: GuidanceStep | None = None

    def __enter__(self) -> GuidanceVideo:
        return self

    def __exit__(self, *error: object) -> None:
        if self._waiting is not None:
            self._write(self._waiting, self._waiting)
        self._writer.close()

    def wants_image(self, tick: int) -> bool:
        return tick % self._every == 0

    def see(self, tick: int, step: GuidanceStep) -> None:
        """Take one tick in; its frame is written once the pose in its image is known."""
        waiting = self._waiting
        stamp = -np.inf if step.estimate is None else step.estimate.stamp
        if waiting is not None and stamp >= waiting.state.time - 1e-9:
            self._write(waiting, step)
            self._waiting = None
        self._trail.append(step.state.T_world_body[:3, 3])
        if self.wants_image(tick):
            if self._waiting is not None:
                self._write(self._waiting, None)
            self._waiting = step

    def _write(self, step: GuidanceStep, later: GuidanceStep | None) -> None:
        self._writer.write(np.hstack([self._onboard(step, later), self._outside(step)]))

    def _onboard(
        self, step: GuidanceStep, later: GuidanceStep | None
    ) -> UInt8[np.ndarray, "H W 3"]:
        if step.exposure is None:
            return np.zeros((_SIZE[1], _SIZE[0], 3), np.uint8)
        frame, extents = step.exposure.frame, self._world.target.extents
        image = draw_box_and_axes(
            frame.rgb, frame.K, self._goal, extents, _WHITE, axes=False, thickness=1
        )
        estimate = None if later is None else later.estimate
        state = "no pose yet"
        if estimate is not None:
            T_cam_obj, size = estimate.T_cam_obj, estimate.extents
            image = draw_box_and_axes(image, frame.K, T_cam_obj, size, self._color)
            state = estimate.state.value
        image = draw_label(image, f"onboard camera   poses: {self._title}   {state}")
        return draw_label(image, "thin white box: goal", 1)

    def _outside(self, step: GuidanceStep) -> UInt8[np.ndarray, "H W 3"]:
        state = step.state
        vehicle = self._look.instances(state.T_world_body, state.joints, VEHICLE_ID)
        scene = self._world.scene(state.time, *vehicle)
        camera = self._bystander_at(state.time)
        image = self._draw_trail(render(scene, camera).rgb, camera)
        image = draw_label(image, f"t = {state.time:5.2f} s   servo: {step.command.state.value}")
        cm, deg = 100.0 * step.error.distance, np.degrees(step.error.angle)
        return draw_label(image, f"true error {cm:5.1f} cm  {deg:5.1f} deg", 1)

    def _bystander_at(self, time: float) -> Camera:
        """The bystander goes along with a target that moves."""
        x, y, _ = self._world.path.displacement(time)
        T_world_cam = self._bystander.T_world_cam.copy()
        T_world_cam[:2, 3] += (x, y)
        return replace(self._bystander, T_world_cam=T_world_cam)

    def _draw_trail(
        self, image: UInt8[np.ndarray, "H W 3"], camera: Camera
    ) -> UInt8[np.ndarray, "H W 3"]:
        if len(self._trail) < 2:
            return image
        T_cam_world = invert_transform(camera.T_world_cam)
        points_cam = transform_points(T_cam_world, np.array(self._trail))
        pixels = project(points_cam[points_cam[:, 2] > 0.1], camera.K)
        line = np.rint(np.clip(pixels, -2000, 4000)).astype(np.int32)
        return cv2.polylines(image.copy(), [line[:, None]], False, _TRAIL, 1, cv2.LINE_AA)


def bystander_camera(episode: Episode) -> Camera:
    """A fixed camera at the side that has start and goal of the flight in view."""
    vehicle = episode.T_world_body[:3, 3]
    thing = episode.world.T_world_obj(0.0)[:3, 3]
    middle = 0.5 * (vehicle + thing) + np.array([0.0, 0.0, 0.05])
    along = (vehicle - thing)[:2]
    if np.linalg.norm(along) < 0.05:
        along = episode.T_world_body[:2, 0]
    side = np.array([-along[1], along[0]]) / np.linalg.norm(along)
    if side @ middle[:2] > 0:  # from the middle of the room there is more room that way
        side = -side
    away = max(1.7, 1.25 * float(np.linalg.norm(vehicle - thing)) + 0.5)
    eye = np.array([*(middle[:2] + away * side), middle[2] + 0.3 * away])
    reach = episode.world.half_width - 0.25
    eye = np.clip(eye, [-reach, -reach, 0.5], [reach, reach, 2.8])
    width, height = _SIZE
    K = np.array(
        [[_FOCAL_PX, 0.0, (width - 1) / 2], [0.0, _FOCAL_PX, (height - 1) / 2], [0.0, 0.0, 1.0]]
    )
    return Camera(K, width, height, _looking(eye, middle))


def _looking(eye: Float[np.ndarray, "3"], at: Float[np.ndarray, "3"]) -> Float[np.ndarray, "4 4"]:
    """T_world_cam of a camera at `eye` that looks `at`, upright."""
    forward = (at - eye) / np.linalg.norm(at - eye)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    return make_transform(np.stack([right, np.cross(forward, right), forward], axis=1), eye)
