"""YCB-Video annotates its own axes (z up); the trackers of its objects speak this package's (y up).

Both boxes have the same middle, so all that differs is one turn, `ycb_objects.R_YCBV_OBJ`.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from robust6dof.frames import Box, PoseTracker, RgbdFrame, Track
from robust6dof.geometry.transforms import invert_transform, make_transform
from robust6dof.shapes.mesh import TexturedMesh
from robust6dof.shapes.ycb_objects import R_YCBV_OBJ

_T_YCBV_OBJ = make_transform(R_YCBV_OBJ, np.zeros(3))


def upright_box(
    T_cam_ycbv: Float[np.ndarray, "4 4"], extents: Float[np.ndarray, "3"]
) -> tuple[Float[np.ndarray, "4 4"], Float[np.ndarray, "3"]]:
    """`T_cam_obj` and sides in this package's axes, of a box in YCB-Video's."""
    return T_cam_ycbv @ _T_YCBV_OBJ, other_sides(extents)


def other_sides(extents: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
    """Sides along either's axes, of those along the other's: y and z change places."""
    return np.abs(extents @ R_YCBV_OBJ)


@dataclass
class YcbVideoAxes:
    """A tracker that is started and read in YCB-Video's axes of the object's box."""

    tracker: PoseTracker

    def start(
        self,
        frame: RgbdFrame,
        *,
        mask: Bool[np.ndarray, "H W"] | None = None,
        box: Box | None = None,
        T_cam_obj: Float[np.ndarray, "4 4"] | None = None,
        extents: Float[np.ndarray, "3"] | None = None,
    ) -> Track:
        T_cam_upright = None if T_cam_obj is None else T_cam_obj @ _T_YCBV_OBJ
        sides = None if extents is None else other_sides(extents)
        track = self.tracker.start(
            frame, mask=mask, box=box, T_cam_obj=T_cam_upright, extents=sides
        )
        return _turned(track, invert_transform(_T_YCBV_OBJ))

    def step(self, track: Track, frame: RgbdFrame) -> Track:
        upright = _turned(track, _T_YCBV_OBJ)
        return _turned(self.tracker.step(upright, frame), invert_transform(_T_YCBV_OBJ))


def upright_mesh(source: Callable[[], TexturedMesh]) -> TexturedMesh:
    """The mesh in this package's axes, of one that is given in YCB-Video's."""
    mesh = source()
    return replace(mesh, vertices=mesh.vertices @ R_YCBV_OBJ)


def _turned(track: Track, T_obj_other: Float[np.ndarray, "4 4"]) -> Track:
    """The same box with its axes named otherwise."""
    sides = other_sides(track.extents)
    return replace(track, T_cam_obj=track.T_cam_obj @ T_obj_other, extents=sides)
