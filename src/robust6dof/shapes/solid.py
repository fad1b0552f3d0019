"""Unions and cuts of closed parts, which keep texture coordinates, and the finished object."""

from __future__ import annotations

from collections.abc import Sequence

import manifold3d
import numpy as np
from jaxtyping import Float, Int

from robust6dof.shapes.atlas import Atlas
from robust6dof.shapes.draw import Draw
from robust6dof.shapes.loft import Part
from robust6dof.shapes.mesh import Material, ObjectModel, TexturedMesh


def union(parts: Sequence[Part]) -> Part:
    """One closed surface around all parts; what lies inside another part is gone."""
    return _combine(parts, manifold3d.OpType.Add)


def subtract(solid: Part, cutters: Sequence[Part]) -> Part:
    """The solid less the cutters; the cut faces carry the cutters' texture."""
    return _combine([solid, *cutters], manifold3d.OpType.Subtract)


def _combine(parts: Sequence[Part], operation: manifold3d.OpType) -> Part:
    solids = [_to_manifold(part) for part in parts]
    mesh = manifold3d.Manifold.batch_boolean(solids, operation).to_mesh64()
    table = np.asarray(mesh.vert_properties)
    return Part(
        table[:, :3].copy(), np.asarray(mesh.tri_verts).astype(np.int64), table[:, 3:5].copy()
    )


def _to_manifold(part: Part) -> manifold3d.Manifold:
    first, inverse = merge_by_position(part.vertices)
    doubled = np.flatnonzero(first[inverse] != np.arange(len(inverse)))
    mesh = manifold3d.Mesh64(
        np.ascontiguousarray(np.hstack([part.vertices, part.uv])),
        np.ascontiguousarray(part.faces.astype(np.uint64)),
        merge_from_vert=doubled.astype(np.uint64),
        merge_to_vert=first[inverse][doubled].astype(np.uint64),
    )
    solid = manifold3d.Manifold(mesh)
    if solid.status() != manifold3d.Error.NoError:
        raise ValueError(f"part is not a closed surface: {solid.status()}")
    return solid


def merge_by_position(
    vertices: Float[np.ndarray, "V 3"],
) -> tuple[Int[np.ndarray, "M"], Int[np.ndarray, "V"]]:
    """Vertices at the same place as one.

    Returns:
        the first vertex of each place, and the place of each vertex.
    """
    _, first, inverse = np.unique(vertices, axis=0, return_index=True, return_inverse=True)
    return first, inverse.reshape(-1)


def finish(part: Part, atlas: Atlas, material: Material, category: str, draw: Draw) -> ObjectModel:
    """The object, centred on its bounding box."""
    middle = (part.vertices.min(axis=0) + part.vertices.max(axis=0)) / 2
    mesh = TexturedMesh(part.vertices - middle, part.faces, part.uv, atlas.image, material)
    return ObjectModel(mesh, category, f"procedural_{category}", dict(draw.parameters))
