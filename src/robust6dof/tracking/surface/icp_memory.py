"""What the ICP carries from frame to frame, and when its model takes in a view."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Bool, Float

from robust6dof.frames import RgbdFrame
from robust6dof.geometry.transforms import view_direction
from robust6dof.tracking.motion import Motion
from robust6dof.tracking.region import depth_noise
from robust6dof.tracking.states import StateCount
from robust6dof.tracking.support_plane import Plane
from robust6dof.tracking.surface.cloud import Cloud
from robust6dof.tracking.surface.fit_quality import NOTHING_SEEN, FitQuality, assess
from robust6dof.tracking.surface.icp_config import IcpConfig
from robust6dof.tracking.surface.registration_target import RegistrationTarget
from robust6dof.tracking.surface.surface_model import SurfaceModel
from robust6dof.tracking.surface.surroundings import Surroundings


@dataclass(frozen=True, eq=False)
class IcpMemory:
    """Immutable; each step makes a new one."""

    surface: SurfaceModel
    target: RegistrationTarget
    plane: Plane | None
    """What the object stood on in the first frame, in the object frame: nothing of the object is
    below."""
    keyframes: Float[np.ndarray, "F 4"]
    """Unit view direction in the object frame and distance [m] of each view in the model."""
    motion: Motion
    surroundings: Surroundings | None
    """None while the object moves on its own."""
    own_motion: int = 0
    """Frames in a row in which the object was found away from its surroundings."""
    free_frames: int = 0
    """Frames since the surroundings were forgotten."""
    surface_known: bool = False
    """The surface is the object's CAD mesh: views add nothing to it."""
    quality: FitQuality = NOTHING_SEEN
    """Of the last frame's fit."""
    probation: int = 0
    """Good frames to go until views are taken in again."""
    frames: int = 1
    count: StateCount = field(default_factory=StateCount)

    def watching_own_motion(self, left: bool, config: IcpConfig) -> IcpMemory:
        """Forget the surroundings once the object has left them for some frames."""
        count = self.own_motion + 1 if left else 0
        if count >= config.own_motion_frames:
            return replace(self, surroundings=None, own_motion=0, free_frames=0)
        free = self.free_frames + 1 if self.surroundings is None else 0
        return replace(self, own_motion=count, free_frames=free)

    def on_probation(self, lost: bool, confidence: float, config: IcpConfig) -> IcpMemory:
        """After one more frame: a loss begins the probation, good frames end it."""
        if lost:
            return replace(self, probation=config.probation_frames)
        passed = int(confidence >= config.growth_confidence)
        return replace(self, probation=max(self.probation - passed, 0))

    def is_trusted(self, config: IcpConfig) -> bool:
        """Whether the last fit may be learned from."""
        fits = self.quality.shape_confidence >= config.growth_confidence
        return fits and self.quality.color_gap <= config.growth_color_gap and not self.probation

    def wants(self, T_cam_obj: np.ndarray, config: IcpConfig) -> bool:
        """Whether a view from here would tell the model something new."""
        if self.frames <= config.settle_frames:
            return True
        view = view_of(T_cam_obj)
        cosines = np.clip(self.keyframes[:, :3] @ view[:3], -1.0, 1.0)
        far = np.degrees(np.arccos(cosines)) > config.keyframe_angle_deg
        nearer = self.keyframes[:, 3] > config.keyframe_distance_ratio * view[3]
        return bool((far | nearer).all())

    def with_view(
        self, frame: RgbdFrame, T_cam_obj: np.ndarray, extents: np.ndarray, view: Cloud
    ) -> IcpMemory:
        """Take in a view of the object and of what is around it; drop what it sees through."""
        around = self.surroundings
        if around is not None and self.own_motion == 0:
            around = around.with_view(around.cut(frame, T_cam_obj, extents))
        keyframes = np.concatenate([self.keyframes, view_of(T_cam_obj)[None]])
        memory = replace(self, keyframes=keyframes, surroundings=around)
        if self.surface_known:
            return memory
        _, refuted = assess_surface(frame, T_cam_obj, self.surface, every=1)
        surface = self.surface.carved(refuted).merged(view, view_weight(T_cam_obj))
        return replace(memory, surface=surface, target=RegistrationTarget.build(surface.cloud))


def assess_surface(
    frame: RgbdFrame, T_cam_obj: np.ndarray, surface: SurfaceModel, every: int = 0
) -> tuple[FitQuality, Bool[np.ndarray, "P"]]:
    """`assess` for about a thousand of the model's points, or for each `every`-th."""
    step = every or max(1, len(surface) // 1000)
    return assess(frame, T_cam_obj, surface.cloud[::step], spacing=surface.voxel)


def view_weight(T_cam_obj: Float[np.ndarray, "4 4"]) -> float:
    """Of a view's points: the inverse variance of their depth, near 1 under a millimetre."""
    return float(1e-6 / (1e-6 + depth_noise(T_cam_obj[2, 3]) ** 2))


def view_of(T_cam_obj: Float[np.ndarray, "4 4"]) -> Float[np.ndarray, "4"]:
    """Direction to the camera in the object frame, and its distance [m]."""
    return np.append(view_direction(T_cam_obj), np.linalg.norm(T_cam_obj[:3, 3]))
