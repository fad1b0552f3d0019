"""What the rasteriser needs of a mesh beside its vertices, computed once per mesh."""

from __future__ import annotations

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import cv2
import numpy as np
from jaxtyping import Float, Float32, Float64, Int, Int32, Int64, UInt8
from scipy import sparse

from robust6dof.errors import InputError
from robust6dof.shapes.mesh import TexturedMesh

CREASE_ANGLE_DEG = 35.0
"""Faces that meet at a larger angle keep a sharp edge between them."""


@dataclass(frozen=True, eq=False)
class PreparedMesh:
    """A mesh in the layout of the compiled loops."""

    vertices: Float64[np.ndarray, "V 3"]
    faces: Int32[np.ndarray, "F 3"]
    corner_uv: Float32[np.ndarray, "F 3 2"]
    corner_normals: Float32[np.ndarray, "F 3 3"]
    """Unit normals of each face's corners, in the mesh frame."""
    texel_density: Float32[np.ndarray, "F"]
    """Texels per metre on each face."""
    texels: UInt8[np.ndarray, "P 3"]
    """All levels of the texture pyramid, row-major, one after the other."""
    levels: Int64[np.ndarray, "L 3"]
    """First texel, height and width of each level."""


_prepared: WeakKeyDictionary[TexturedMesh, PreparedMesh] = WeakKeyDictionary()


def prepare_mesh(mesh: TexturedMesh) -> PreparedMesh:
    """Compute, or recall for the same mesh object, what the rasteriser needs.

    Raises:
        InputError: the faces name vertices that are not there.
    """
    prepared = _prepared.get(mesh)
    if prepared is None:
        prepared = _prepare(mesh)
        _prepared[mesh] = prepared
    return prepared


def _prepare(mesh: TexturedMesh) -> PreparedMesh:
    vertices = np.ascontiguousarray(mesh.vertices, dtype=np.float64)
    faces = np.ascontiguousarray(mesh.faces, dtype=np.int32)
    if faces.size and (faces.min() < 0 or faces.max() >= len(vertices)):
        raise InputError(
            f"the mesh's faces name vertices {faces.min()} to {faces.max()}, but it has "
            f"{len(vertices)}, numbered from 0"
        )
    corner_uv = np.nan_to_num(np.asarray(mesh.uv, dtype=np.float32))[faces]
    texels, levels = _texture_pyramid(mesh.texture)
    return PreparedMesh(
        vertices,
        faces,
        corner_uv,
        corner_normals(vertices, faces),
        _texel_density(vertices[faces], corner_uv, mesh.texture.shape[:2]),
        texels,
        levels,
    )


def corner_normals(
    vertices: Float[np.ndarray, "V 3"],
    faces: Int[np.ndarray, "F 3"],
    crease_angle_deg: float = CREASE_ANGLE_DEG,
) -> Float32[np.ndarray, "F 3 3"]:
    """Unit normals of each face's corners: smooth, but sharp across creases.

    A corner's normal is the mean over the faces at the same position whose normals lie within the
    crease angle of its own face's, weighted by their angles there (Thürmer and Wüthrich, 1998), so
    that it does not depend on the triangulation. Vertices at equal positions count as one, so
    texture seams do not show.
    """
    if len(faces) == 0:
        return np.zeros((0, 3, 3), np.float32)
    unit_normals, angles = _face_normals_and_angles(vertices[faces])
    _, position = np.unique(vertices, axis=0, return_inverse=True)
    corner = np.arange(faces.size)
    position = position.ravel()[faces.ravel()]
    at_position = sparse.csr_array((np.ones(faces.size, np.float32), (corner, position)))
    corner_i, corner_j = (at_position @ at_position.T).tocoo().coords
    normals_j = unit_normals[corner_j // 3]
    cosines = np.einsum("pi,pi->p", unit_normals[corner_i // 3], normals_j)
    smooth = cosines >= np.cos(np.radians(crease_angle_deg))
    weighted = normals_j[smooth] * angles[corner_j[smooth], None]
    gather = sparse.csr_array(
        (np.ones(len(weighted)), (corner_i[smooth], np.arange(len(weighted)))),
        shape=(faces.size, len(weighted)),
    )
    sums = gather @ weighted
    norms = np.linalg.norm(sums, axis=1, keepdims=True)
    flat = np.repeat(unit_normals, 3, axis=0)
    normals = np.where(norms > 1e-12, sums / np.maximum(norms, 1e-12), flat)
    return normals.reshape(-1, 3, 3).astype(np.float32)


def _face_normals_and_angles(
    corners: Float[np.ndarray, "F 3 3"],
) -> tuple[Float[np.ndarray, "F 3"], Float[np.ndarray, "C"]]:
    """Unit normal of each face (zero without area) and the angle at each of its corners [rad]."""
    area_normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    twice_area = np.linalg.norm(area_normals, axis=1, keepdims=True)
    to_next = np.roll(corners, -1, axis=1) - corners
    to_previous = np.roll(corners, 1, axis=1) - corners
    angles = np.arctan2(twice_area, np.sum(to_next * to_previous, axis=-1))
    return area_normals / np.maximum(twice_area, 1e-30), angles.ravel()


def _texel_density(
    corners: np.ndarray, corner_uv: np.ndarray, texture_size: tuple[int, int]
) -> Float32[np.ndarray, "F"]:
    side_1, side_2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    areas = np.linalg.norm(np.cross(side_1, side_2), axis=1)
    uv_1, uv_2 = corner_uv[:, 1] - corner_uv[:, 0], corner_uv[:, 2] - corner_uv[:, 0]
    uv_areas = np.abs(uv_1[:, 0] * uv_2[:, 1] - uv_1[:, 1] * uv_2[:, 0])
    texel_areas = uv_areas * texture_size[0] * texture_size[1]
    return np.sqrt(texel_areas / np.maximum(areas, 1e-20)).astype(np.float32)


def _texture_pyramid(
    texture: UInt8[np.ndarray, "Th Tw 3"],
) -> tuple[UInt8[np.ndarray, "P 3"], Int64[np.ndarray, "L 3"]]:
    """The texture and its halvings down to one texel, so that distant texture does not flicker."""
    images = [np.ascontiguousarray(texture)]
    while max(images[-1].shape[:2]) > 1:
        height, width = images[-1].shape[:2]
        half = (max(width // 2, 1), max(height // 2, 1))
        images.append(cv2.resize(images[-1], half, interpolation=cv2.INTER_AREA))
    starts = np.cumsum([0] + [image.shape[0] * image.shape[1] for image in images[:-1]])
    levels = np.array([(s, *i.shape[:2]) for s, i in zip(starts, images, strict=True)], np.int64)
    return np.concatenate([image.reshape(-1, 3) for image in images]), levels
