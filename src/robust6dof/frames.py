"""What flows between the parts: a frame goes in, a track comes out."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float, Float32, UInt8

from robust6dof.errors import InputError
from robust6dof.geometry.camera import check_intrinsics
from robust6dof.geometry.transforms import check_rotation

CATEGORIES = ("bottle", "bowl", "camera", "can", "laptop", "mug")
"""The six categories of the paper, in the order of the NOCS class ids 1 to 6."""

YCB_OBJECTS = (
    "002_master_chef_can",
    "003_cracker_box",
    "004_sugar_box",
    "005_tomato_soup_can",
    "006_mustard_bottle",
    "007_tuna_fish_can",
    "008_pudding_box",
    "009_gelatin_box",
    "010_potted_meat_can",
    "011_banana",
    "019_pitcher_base",
    "021_bleach_cleanser",
    "024_bowl",
    "025_mug",
    "035_power_drill",
    "036_wood_block",
    "037_scissors",
    "040_large_marker",
    "051_large_clamp",
    "052_extra_large_clamp",
    "061_foam_brick",
)
"""The objects of YCB-Video, in the order of its class ids 1 to 21."""

SYMMETRIC_CATEGORIES = frozenset({"bottle", "bowl", "can", "024_bowl"})
"""Rotation about the canonical y means nothing for these (a mug only while its handle hides)."""


@dataclass(frozen=True, eq=False)
class RgbdFrame:
    """One registered RGB-D image.

    Raises:
        InputError: arrays of different sizes, intrinsics that do not fit them, or an orientation
            that is no rotation.
    """

    rgb: UInt8[np.ndarray, "H W 3"]
    """Colour, RGB order. All zeros where the recording has depth alone (`has_color` False)."""
    depth: Float32[np.ndarray, "H W"]
    """Distance along the optical axis [m]; 0 where invalid."""
    K: Float[np.ndarray, "3 3"]
    """Pinhole intrinsics [px], row-major."""
    stamp: float | None = None
    """Time of exposure [s], where known."""
    name: str = ""
    """The recording's own name of the frame (file stem)."""
    has_color: bool = True
    """False where `rgb` carries nothing, so that only depth may be used."""
    R_ref_cam: Float[np.ndarray, "3 3"] | None = None
    """Orientation of the camera in any frame that stands still, by a gyro (see `geometry.gyro`) or
    an attitude estimate; where given, trackers use its turn from frame to frame."""

    def __post_init__(self) -> None:
        if self.rgb.shape[:2] != self.depth.shape:
            raise InputError(
                f"colour is {self.rgb.shape[1]}×{self.rgb.shape[0]} but depth is "
                f"{self.depth.shape[1]}×{self.depth.shape[0]}; register the depth first"
            )
        object.__setattr__(self, "K", check_intrinsics(self.K, self.width, self.height))
        if self.R_ref_cam is not None:
            object.__setattr__(self, "R_ref_cam", check_rotation(self.R_ref_cam, "R_ref_cam"))

    @property
    def height(self) -> int:
        return self.depth.shape[0]

    @property
    def width(self) -> int:
        return self.depth.shape[1]


@dataclass(frozen=True)
class Box:
    """An image box in pixels: left and top edge, width and height."""

    x: float
    y: float
    width: float
    height: float


class TrackState(StrEnum):
    """What the tracker believes of its own pose."""

    TRACKING = "tracking"
    UNCERTAIN = "uncertain"
    LOST = "lost"
    RECOVERING = "recovering"


@dataclass(frozen=True, eq=False)
class Track:
    """The pose of one object in one frame, with all that the next step needs. Immutable."""

    T_cam_obj: Float[np.ndarray, "4 4"]
    """Rigid transform from the object frame (metric, centred on its box, y up) to the camera."""
    extents: Float[np.ndarray, "3"]
    """Side lengths of the object's box along its own axes [m]."""
    confidence: float
    """Trust in this pose, 0 to 1."""
    state: TrackState
    category: str
    object_name: str = "object_0"
    """Which object of the recording this is."""
    stamp: float | None = None
    """Time stamp of the frame [s], where known."""
    memory: Any = field(default=None, repr=False)
    """What the tracker carries to its next step; its own business."""

    @property
    def scale(self) -> float:
        """Diagonal of the box [m]: the NOCS scale."""
        return float(np.linalg.norm(self.extents))


@runtime_checkable
class PoseTracker(Protocol):
    """What every tracker here does: the network's, the baselines' and stored results."""

    def start(
        self,
        frame: RgbdFrame,
        *,
        mask: Bool[np.ndarray, "H W"] | None = None,
        box: Box | None = None,
        T_cam_obj: Float[np.ndarray, "4 4"] | None = None,
        extents: Float[np.ndarray, "3"] | None = None,
    ) -> Track:
        """Begin on the first frame, from any hint given.

        Raises:
            InputError: no hint, an empty mask, no valid depth on the object.
        """
        ...

    def step(self, track: Track, frame: RgbdFrame) -> Track:
        """Follow the object from the frame of `track` to `frame`; never raises on a bad image."""
        ...
