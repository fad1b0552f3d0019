"""An exact z-buffer rasteriser: meshes and a camera to colour, depth and ids.

Runs on one core from a pip wheel alone: no OpenGL, display or compiler. Depth is the exact
intersection of each pixel centre's ray with the triangle; the same input gives the same bytes.
Back faces are drawn and lit like front faces, since meshes from elsewhere are often double-sided.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32, Float64, Int32, UInt8

from robust6dof.errors import InputError
from robust6dof.geometry.transforms import invert_transform
from robust6dof.rendering import raster_kernels, shading_kernels
from robust6dof.rendering.prepared_mesh import PreparedMesh, prepare_mesh
from robust6dof.rendering.scene import Camera, MeshInstance, Rendering, Scene

NEAR_M = 0.01
"""Surfaces closer to the camera's plane than this are not drawn [m]."""


@dataclass(frozen=True, eq=False)
class _PlacedMesh:
    """A prepared mesh in front of the camera."""

    instance: MeshInstance
    prepared: PreparedMesh
    vertices_cam: Float64[np.ndarray, "V 3"]
    first: int
    """Number of its first triangle in the triangle image."""


@dataclass(frozen=True, eq=False)
class _Coverage:
    """Which triangle each pixel sees."""

    meshes: list[_PlacedMesh]
    inverse_depth: Float64[np.ndarray, "H W"]
    triangles: Int32[np.ndarray, "H W"]
    K_inv: Float64[np.ndarray, "3 3"]


def render(scene: Scene, camera: Camera) -> Rendering:
    """Draw the scene: textured, Lambert and Blinn-Phong shading per pixel.

    Colour is texture · (ambient + Σ light · max(n·l, 0)) + specular · Σ light · max(n·h, 0)^s with
    the half vector h (Blinn, 1977) and s rounded to an even number; no gamma curve is applied.

    Raises:
        InputError: unusable intrinsics or faces.
    """
    coverage = _cover(scene, camera)
    background_row = np.tile(np.array(scene.background, np.uint8), camera.width)
    rgb = np.tile(background_row, camera.height).reshape(camera.height, camera.width, 3)
    for placed in coverage.meshes:
        _shade(placed, coverage, scene, camera, rgb)
    return Rendering(rgb, _depth(coverage), _ids(coverage))


def render_depth(
    scene: Scene, camera: Camera
) -> tuple[Float32[np.ndarray, "H W"], Int32[np.ndarray, "H W"]]:
    """Depth [m] and ids of `render`, bit for bit, without the cost of shading."""
    coverage = _cover(scene, camera)
    return _depth(coverage), _ids(coverage)


def _cover(scene: Scene, camera: Camera) -> _Coverage:
    K = _check_intrinsics(camera.K)
    coverage = _Coverage(
        _place(scene, camera, K),
        np.zeros((camera.height, camera.width)),
        np.zeros((camera.height, camera.width), np.int32),
        np.linalg.inv(K),
    )
    for placed in coverage.meshes:
        raster_kernels.draw_depth(
            placed.vertices_cam,
            placed.prepared.faces,
            placed.first,
            K,
            coverage.K_inv,
            NEAR_M,
            coverage.inverse_depth,
            coverage.triangles,
        )
    return coverage


def _check_intrinsics(K: np.ndarray) -> Float64[np.ndarray, "3 3"]:
    """Any pinhole, also a crop's, whose principal point lies far outside its image."""
    K = np.array(K, dtype=np.float64)
    if K.shape != (3, 3) or not np.isfinite(K).all() or not np.allclose(K[[1, 2, 2], [0, 0, 1]], 0):
        raise InputError(f"intrinsics must read fx s cx / 0 fy cy / 0 0 1, got {K.tolist()}")
    if K[0, 0] <= 0 or K[1, 1] <= 0 or not np.isclose(K[2, 2], 1):
        raise InputError(f"intrinsics need positive focal lengths and K[2, 2] = 1: {K.tolist()}")
    return K


def _place(scene: Scene, camera: Camera, K: np.ndarray) -> list[_PlacedMesh]:
    """Bring every mesh that may be in view into the camera frame, and number its triangles."""
    T_cam_world = invert_transform(np.asarray(camera.T_world_cam, dtype=np.float64))
    meshes: list[_PlacedMesh] = []
    first = 1
    for instance in scene.instances:
        if instance.instance_id < 1:
            raise InputError(f"instance_id must be 1 or more, got {instance.instance_id}")
        prepared = prepare_mesh(instance.mesh)
        T_cam_mesh = T_cam_world @ instance.T_world_mesh
        vertices_cam = prepared.vertices @ T_cam_mesh[:3, :3].T + T_cam_mesh[:3, 3]
        if _may_be_visible(vertices_cam, K, camera):
            vertices_cam = np.ascontiguousarray(vertices_cam)
            meshes.append(_PlacedMesh(instance, prepared, vertices_cam, first))
            first += len(prepared.faces)
    return meshes


def _may_be_visible(vertices_cam: np.ndarray, K: np.ndarray, camera: Camera) -> bool:
    """False if all vertices lie outside the same plane of the viewing frustum."""
    if len(vertices_cam) == 0:
        return False
    z = vertices_cam[:, 2]
    u, v = vertices_cam @ K[0], vertices_cam @ K[1]
    return bool(
        z.max() > NEAR_M
        and (u + 0.5 * z).max() >= 0
        and (v + 0.5 * z).max() >= 0
        and (u - (camera.width - 0.5) * z).min() <= 0
        and (v - (camera.height - 0.5) * z).min() <= 0
    )


def _depth(coverage: _Coverage) -> Float32[np.ndarray, "H W"]:
    seen = coverage.triangles > 0
    depth = 1.0 / np.where(seen, coverage.inverse_depth, 1.0)
    return (depth * seen).astype(np.float32)


def _ids(coverage: _Coverage) -> Int32[np.ndarray, "H W"]:
    counts = [1] + [len(placed.prepared.faces) for placed in coverage.meshes]
    owners = [0] + [placed.instance.instance_id for placed in coverage.meshes]
    return np.repeat(np.array(owners, np.int32), counts)[coverage.triangles]


def _shade(
    placed: _PlacedMesh,
    coverage: _Coverage,
    scene: Scene,
    camera: Camera,
    rgb: UInt8[np.ndarray, "H W 3"],
) -> None:
    prepared, material = placed.prepared, placed.instance.mesh.material
    R_mesh_world = np.asarray(placed.instance.T_world_mesh, dtype=np.float64)[:3, :3].T
    rays_mesh = R_mesh_world @ camera.T_world_cam[:3, :3] @ coverage.K_inv
    towards_lights = [-np.asarray(light.direction_world) for light in scene.lights]
    rows, columns = _image_part(placed.vertices_cam, camera)
    shading_kernels.shade(
        coverage.triangles,
        coverage.inverse_depth,
        placed.first,
        rows,
        columns,
        placed.vertices_cam,
        prepared.faces,
        prepared.corner_uv,
        prepared.corner_normals,
        prepared.texel_density,
        prepared.texels,
        prepared.levels,
        np.ascontiguousarray(rays_mesh),
        coverage.K_inv,
        np.array(towards_lights, np.float64).reshape(-1, 3) @ R_mesh_world.T,
        np.array([light.color for light in scene.lights], np.float64).reshape(-1, 3),
        np.array(scene.ambient, np.float64),
        float(material.specular),
        max(round(material.shininess / 2), 1),
        rgb,
    )


def _image_part(
    vertices_cam: Float[np.ndarray, "V 3"], camera: Camera
) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns (first, last plus one) outside which the mesh cannot be seen."""
    size = np.array([camera.width, camera.height])
    if vertices_cam[:, 2].min() <= NEAR_M:
        low, high = np.zeros(2, np.int64), size
    else:
        pixels = vertices_cam @ camera.K[:2].T / vertices_cam[:, 2:]
        low = np.clip(np.floor(pixels.min(axis=0)), 0, size).astype(np.int64)
        high = np.clip(np.ceil(pixels.max(axis=0)) + 1, 0, size).astype(np.int64)
    columns, rows = np.stack([low, high], axis=1)
    return rows, columns
