"""The eye-in-hand camera of a hovering and manoeuvring multirotor that looks down at an object."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from robust6dof.geometry.transforms import invert_transform, make_transform
from robust6dof.synthetic.difficulty import Difficulty
from robust6dof.synthetic.signals import Event, SmoothNoise, draw_events

_REST_SWING = 0.4
_NOISE_SHARE = 0.65
"""Of the swing's rate that the signals may use; the bursts' rise and fall use the rest."""
_STEP_S = 1e-4
R_WORLD_DOWN = np.diag([1.0, -1.0, -1.0])
"""A camera that looks straight down with its x axis along the world's x."""


@dataclass(frozen=True, eq=False)
class CameraMotion:
    """T_world_cam over time, smooth, for a target at a given place.

    The camera circles the target (azimuth, elevation, range), turns about its optical axis with the
    vehicle's heading, and swings in pitch and roll. A share of the swing is about the target, as
    when arm and vehicle hold it in view; the rest shifts the image.
    """

    azimuth: SmoothNoise
    elevation: SmoothNoise
    range: SmoothNoise
    heading: SmoothNoise
    swing: tuple[SmoothNoise, SmoothNoise, SmoothNoise]
    """Rotation vector in the camera frame: pitch, yaw, roll."""
    aim: tuple[SmoothNoise, SmoothNoise]
    """Where the optical axis passes the target, as angles right and down [rad]."""
    bursts: tuple[Event, ...]
    leaves: tuple[Event, ...]
    leave_direction: float
    start_azimuth: float
    start_heading: float
    mean_elevation: float
    least_elevation: float
    """Of the nominal view [rad]; leaves room for the swing above the table."""
    mean_range: float
    held: float
    """Share of the swing that turns about the target instead of about the camera."""

    @staticmethod
    def draw(rng: np.random.Generator, difficulty: Difficulty, duration: float) -> CameraMotion:
        """A motion of the given difficulty for `duration` seconds."""
        d = difficulty
        mean_range = rng.uniform(0.55, 0.95)
        return CameraMotion(
            azimuth=SmoothNoise.draw(rng, rng.uniform(0.5, 1.0) * np.pi, d.orbit_rate),
            elevation=SmoothNoise.draw(rng, np.deg2rad(18), 0.5 * d.orbit_rate),
            range=SmoothNoise.draw(rng, 0.35 * mean_range, d.radial_speed),
            heading=SmoothNoise.draw(rng, rng.uniform(0.2, 0.8) * np.pi, d.orbit_rate),
            swing=_draw_swing(rng, d),
            aim=(
                SmoothNoise.draw(rng, np.deg2rad(8), np.deg2rad(12)),
                SmoothNoise.draw(rng, np.deg2rad(5), np.deg2rad(10)),
            ),
            bursts=_draw_bursts(rng, d, duration),
            leaves=draw_events(
                rng, duration, d.leave_period, rise=(0.35, 0.6), hold=(0.2, 1.2), quiet=1.0
            ),
            leave_direction=rng.uniform(0, 2 * np.pi),
            start_azimuth=rng.uniform(0, 2 * np.pi),
            start_heading=rng.uniform(0, 2 * np.pi),
            mean_elevation=np.deg2rad(rng.uniform(42, 70)),
            least_elevation=np.deg2rad(26) + d.swing,
            mean_range=mean_range,
            held=rng.uniform(0.6, 0.9),
        )

    def T_world_cam(self, t: float, target_world: Float[np.ndarray, "3"]) -> np.ndarray:
        """Camera transform at time `t` [s] for a target at `target_world` [m]."""
        distance = self.mean_range + self.range(t)
        T_world_view = self._nominal_view(t, distance, target_world)
        swing = self.swing_vector(t)
        pivot = self.held * distance
        T_view_cam = make_transform(Rotation.from_rotvec(swing).as_matrix(), np.zeros(3))
        T_view_cam[:3, 3] = np.array([0, 0, pivot]) - T_view_cam[:3, :3] @ [0, 0, pivot]
        T_cam_aimed = make_transform(self._aim_rotation(t), np.zeros(3))
        return T_world_view @ T_view_cam @ T_cam_aimed

    def _nominal_view(
        self, t: float, distance: float, target_world: Float[np.ndarray, "3"]
    ) -> Float[np.ndarray, "4 4"]:
        """Looking at the target; the shortest turn from straight down has no singular view."""
        azimuth = self.start_azimuth + self.azimuth(t)
        elevation = np.clip(self.mean_elevation + self.elevation(t), self.least_elevation, 1.55)
        outward = np.array(
            [
                np.cos(elevation) * np.cos(azimuth),
                np.cos(elevation) * np.sin(azimuth),
                np.sin(elevation),
            ]
        )
        lean_axis = np.cross([0.0, 0.0, 1.0], outward)
        lean = lean_axis / max(float(np.linalg.norm(lean_axis)), 1e-12) * (np.pi / 2 - elevation)
        turn = Rotation.from_euler("z", self.start_heading + self.heading(t))
        R_world_view = (Rotation.from_rotvec(lean) * turn).as_matrix() @ R_WORLD_DOWN
        return make_transform(R_world_view, target_world + distance * outward)

    def swing_vector(self, t: float) -> Float[np.ndarray, "3"]:
        """Rotation vector (pitch, yaw, roll) [rad] of the swing at time `t` [s]."""
        burst = max((event(t) for event in self.bursts), default=0.0)
        weight = _REST_SWING + (1.0 - _REST_SWING) * burst
        return weight * np.array([signal(t) for signal in self.swing])

    def _aim_rotation(self, t: float) -> Float[np.ndarray, "3 3"]:
        away = max((event(t) for event in self.leaves), default=0.0) * np.deg2rad(55)
        right = self.aim[0](t) + away * np.cos(self.leave_direction)
        down = self.aim[1](t) + away * np.sin(self.leave_direction)
        return Rotation.from_rotvec([-down, right, 0.0]).as_matrix()


def twist_along(
    T_ref_cam: Callable[[float], Float[np.ndarray, "4 4"]], t: float
) -> Float[np.ndarray, "6"]:
    """Linear and angular velocity of a camera in its own frame [m/s, rad/s], from its motion.

    Central difference of `T_ref_cam` at time `t` [s].
    """
    T_before_after = invert_transform(T_ref_cam(t - _STEP_S)) @ T_ref_cam(t + _STEP_S)
    rotvec = Rotation.from_matrix(T_before_after[:3, :3]).as_rotvec()
    return np.concatenate([T_before_after[:3, 3], rotvec]) / (2 * _STEP_S)


def _draw_swing(
    rng: np.random.Generator, d: Difficulty
) -> tuple[SmoothNoise, SmoothNoise, SmoothNoise]:
    rate = _NOISE_SHARE * d.swing_rate
    pitch = SmoothNoise.draw(rng, d.swing, rate)
    yaw = SmoothNoise.draw(rng, 0.5 * d.swing, 0.5 * rate)
    roll = SmoothNoise.draw(rng, d.swing, rate)
    return pitch, yaw, roll


def _draw_bursts(rng: np.random.Generator, d: Difficulty, duration: float) -> tuple[Event, ...]:
    """Bursts that rise no faster than the rate's bound leaves beside that of the swing itself."""
    rise = (1.0 - _REST_SWING) * d.swing * Event.STEEPEST / ((1.0 - _NOISE_SHARE) * d.swing_rate)
    return draw_events(
        rng, duration, d.burst_period, rise=(rise, 1.5 * rise), hold=(0.3, 1.0), quiet=0.2
    )
