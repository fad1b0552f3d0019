"""Noise on the starting pose, as the trackers' own evaluations add it."""

from __future__ import annotations

from dataclasses import dataclass, fields, is_dataclass, replace

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import Rotation

from robust6dof.errors import InputError
from robust6dof.frames import Box, PoseTracker, RgbdFrame, Track
from robust6dof.geometry.transforms import invert_transform, make_transform

Start = tuple[np.ndarray, np.ndarray | None]
"""T_cam_obj [4, 4] and extents [3] that a tracker is given on its first frame; a data set without
extents gives none."""


@dataclass(frozen=True)
class PertNoise:
    """CAPTRA's "Pert.": the paper's noise ×1."""

    rotation_deg: float = 5.0
    """Standard deviation of the angle about a random axis."""
    translation: float = 0.03
    """Standard deviation [m] of the shift along a random direction."""
    scale: float = 0.02
    """Standard deviation added to the NOCS scale, the box's diagonal [m]."""
    multiple: float = 1.0
    """The paper's ×n; 0 is none."""


def perturb(
    T_cam_obj: Float[np.ndarray, "4 4"],
    extents: Float[np.ndarray, "3"] | None,
    rng: np.random.Generator,
    noise: PertNoise | None = None,
) -> Start:
    """Add "Pert." noise: the rotation about the object's origin, the shift in the camera frame."""
    noise = noise or PertNoise()
    angle = abs(rng.normal(0.0, noise.multiple * np.radians(noise.rotation_deg)))
    R_noise = Rotation.from_rotvec(angle * _direction(rng)).as_matrix()
    shift = rng.normal(0.0, noise.multiple * noise.translation) * _direction(rng)
    added = rng.normal(0.0, noise.multiple * noise.scale)
    noisy = make_transform(R_noise @ T_cam_obj[:3, :3], T_cam_obj[:3, 3] + shift)
    if extents is None:
        return noisy, None
    # A box must keep a size: the Gaussian's tail would turn a small one inside out.
    return noisy, extents * max(1.0 + added / float(np.linalg.norm(extents)), 0.25)


def shift_uniformly(
    T_cam_obj: Float[np.ndarray, "4 4"],
    extents: Float[np.ndarray, "3"] | None,
    rng: np.random.Generator,
) -> Start:
    """6-PACK's start: U(−2, 2) cm on each axis, the rotation and the (mean) size as given."""
    shift = rng.uniform(-0.02, 0.02, 3)
    return make_transform(T_cam_obj[:3, :3], T_cam_obj[:3, 3] + shift), extents


def exact(
    T_cam_obj: Float[np.ndarray, "4 4"],
    extents: Float[np.ndarray, "3"] | None,
    rng: np.random.Generator,
) -> Start:
    """No noise: ground truth on the first frame (YCBInEOAT, YCB-Video)."""
    return T_cam_obj, extents


def _direction(rng: np.random.Generator) -> Float[np.ndarray, "3"]:
    vector = rng.normal(size=3)
    return vector / np.linalg.norm(vector)


@dataclass(frozen=True)
class PoseNoiseTracker:
    """A tracker whose poses are disturbed: the paper's Orig, Init×n (`init`), All×n (`all`).

    `all` disturbs every previous pose that the tracker steps from, the first included; what is
    reported is the tracker's own answer.
    """

    tracker: PoseTracker
    rng: np.random.Generator
    init: float = 0.0
    """n of Init×n."""
    all: float = 0.0
    """n of All×n."""

    def start(
        self,
        frame: RgbdFrame,
        *,
        mask: Bool[np.ndarray, "H W"] | None = None,
        box: Box | None = None,
        T_cam_obj: Float[np.ndarray, "4 4"] | None = None,
        extents: Float[np.ndarray, "3"] | None = None,
    ) -> Track:
        if T_cam_obj is None or extents is None:
            raise InputError("pose noise needs a starting pose and extents to disturb")
        T_cam_obj, extents = perturb(T_cam_obj, extents, self.rng, PertNoise(multiple=self.init))
        return self.tracker.start(frame, mask=mask, box=box, T_cam_obj=T_cam_obj, extents=extents)

    def step(self, track: Track, frame: RgbdFrame) -> Track:
        if self.all > 0.0:
            noisy, _ = perturb(
                track.T_cam_obj, track.extents, self.rng, PertNoise(multiple=self.all)
            )
            track = displaced(track, noisy)
        return self.tracker.step(track, frame)


def displaced(track: Track, T_cam_obj: Float[np.ndarray, "4 4"]) -> Track:
    """A track whose pose is another, and with it that of a tracker inside its tracker's memory."""
    motion = T_cam_obj @ invert_transform(track.T_cam_obj)
    memory = track.memory
    if is_dataclass(memory) and not isinstance(memory, type):
        values = {one.name: getattr(memory, one.name) for one in fields(memory)}
        inner = {
            name: displaced(value, motion @ value.T_cam_obj)
            for name, value in values.items()
            if isinstance(value, Track)
        }
        memory = replace(memory, **inner)
    return replace(track, T_cam_obj=T_cam_obj, memory=memory)
