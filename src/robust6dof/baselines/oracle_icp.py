"""ICP that is given what no category-level tracker has: the CAD mesh of the very object.

An upper bound of registration, and the "Oracle ICP" column of published tables.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float

from robust6dof.frames import Box, RgbdFrame, Track
from robust6dof.geometry.transforms import check_transform, invert_transform
from robust6dof.shapes.mesh import TexturedMesh
from robust6dof.shapes.sampling import sample_surface
from robust6dof.tracking.initialisation import InitialPose, find_initial_pose
from robust6dof.tracking.region import depth_noise
from robust6dof.tracking.surface.cloud import Cloud
from robust6dof.tracking.surface.icp import IcpTracker
from robust6dof.tracking.surface.icp_config import IcpConfig
from robust6dof.tracking.surface.icp_memory import IcpMemory
from robust6dof.tracking.surface.registration import Evidence, independent, register
from robust6dof.tracking.surface.surface_model import SurfaceModel

_SAMPLES = 12_000
_START_PRIOR = independent(np.radians(15.0), 0.05)
"""Doubt in the first pose, which the mesh corrects."""


class OracleIcpTracker(IcpTracker):
    """`IcpTracker` whose model is the object's mesh from the start, and stays so.

    Args:
        mesh: of the object, centred on its box, in the axes of `T_cam_obj` [m].
        category: of the object.
        config: see its fields.
        seed: of the points drawn on the mesh, and of all else.
    """

    def __init__(
        self, mesh: TexturedMesh, category: str, config: IcpConfig | None = None, *, seed: int = 0
    ) -> None:
        super().__init__(category, config, seed=seed)
        points, normals = sample_surface(mesh, _SAMPLES, np.random.default_rng(seed))
        # Its colours are not compared: the mesh's own light is not the scene's.
        self._cloud = Cloud(points, normals, np.full((_SAMPLES, 3), np.nan))
        self._extents = np.ptp(mesh.vertices, axis=0)

    def start(
        self,
        frame: RgbdFrame,
        *,
        mask: Bool[np.ndarray, "H W"] | None = None,
        box: Box | None = None,
        T_cam_obj: Float[np.ndarray, "4 4"] | None = None,
        extents: Float[np.ndarray, "3"] | None = None,
    ) -> Track:
        """Begin as every tracker, with the mesh's extents, and register the mesh at once."""
        initial = find_initial_pose(
            frame, self.category, mask=mask, box=box, T_cam_obj=T_cam_obj, extents=self._extents
        )
        return self._begun(frame, self._corrected(frame, initial))

    def _corrected(self, frame: RgbdFrame, initial: InitialPose) -> InitialPose:
        """The first pose after two registrations of what is seen to the mesh."""
        memory = self._first_memory(frame, initial)
        noise = float(depth_noise(initial.T_cam_obj[2, 3]))
        stages = self._stages(float(np.linalg.norm(self._extents)), noise)
        for _ in range(2):
            T_start, extents = initial.T_cam_obj, initial.extents
            voxel, share = memory.surface.voxel, self.config.search_share
            view = self._cut(frame, T_start, extents, voxel, memory.plane, share, initial.mask)
            fit = register([Evidence(view, memory.target, noise)], stages, _START_PRIOR)
            if fit is None:
                break
            T_cam_obj = check_transform(T_start @ invert_transform(fit.T_target_source))
            initial = replace(initial, T_cam_obj=T_cam_obj)
        return initial

    def _first_memory(self, frame: RgbdFrame, initial: InitialPose) -> IcpMemory:
        return replace(super()._first_memory(frame, initial), surface_known=True)

    def _first_surface(
        self, blank: SurfaceModel, view: Cloud, T_cam_obj: np.ndarray
    ) -> SurfaceModel:
        return blank.merged(self._cloud, 1.0)
