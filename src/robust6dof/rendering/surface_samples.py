"""Dense points on meshes, with all that a point renderer needs of the surface around each."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
import torch
from jaxtyping import Bool, Float, Float32, Int
from scipy.spatial import KDTree
from torch import Tensor

from robust6dof.errors import InputError
from robust6dof.rendering.prepared_mesh import PreparedMesh, prepare_mesh
from robust6dof.shapes.mesh import TexturedMesh

CLIP_ANGLE_DEG = 20.0
"""Edges that bend the surface by more than this cut the disks beside them."""

DISK_FACTOR = 1.4
"""Radius of a point's disk over √(area / points): large enough to leave no gap."""


@dataclass(frozen=True, eq=False)
class SurfaceSamples:
    """Points of O objects, N on each: disks that cover the surface without gaps.

    Components come before points, which is the fast order for batched products.
    """

    points: Float[Tensor, "O 3 N"]
    """Positions in the object's frame [m]."""
    normals: Float[Tensor, "O 3 N"]
    """Unit normals, smooth over the surface: for shading."""
    planes: Float[Tensor, "O 3 N"]
    """Unit normals of the faces that the points lie on: the planes of their disks."""
    colors: Float[Tensor, "O 3 N"]
    """RGB in 0 … 1."""
    clips: Float[Tensor, "O 4 N"]
    """Where a sharp edge cuts the disk: unit direction towards it and the distance to it [m]."""
    radii: Float[Tensor, "O"]
    """Radius of the disks [m]."""
    scales: Float[Tensor, "O"]
    """Diagonal of each object's box [m]: points over it are canonical coordinates."""
    closed: Bool[Tensor, "O"]
    """Whether the mesh is watertight, so that its inside can never be seen."""

    @classmethod
    def from_meshes(
        cls, meshes: Sequence[TexturedMesh], count: int = 30_000, seed: int = 0
    ) -> SurfaceSamples:
        """Sample each mesh evenly by area; the same seed gives the same points.

        Raises:
            InputError: no mesh, or one without area.
        """
        if not meshes:
            raise InputError("there is no mesh to sample")
        sampled = [
            _sample(mesh, count, np.random.default_rng([seed, i])) for i, mesh in enumerate(meshes)
        ]
        stacked = {name: np.stack([s[name] for s in sampled]) for name in sampled[0]}
        return cls(**{name: torch.from_numpy(values) for name, values in stacked.items()})

    def to(self, device: torch.device | str) -> SurfaceSamples:
        """The same samples on another device."""
        return replace(self, **{f.name: getattr(self, f.name).to(device) for f in fields(self)})

    @property
    def count(self) -> int:
        """Number of objects."""
        return self.points.shape[0]


def _sample(mesh: TexturedMesh, count: int, rng: np.random.Generator) -> dict[str, np.ndarray]:
    prepared = prepare_mesh(mesh)
    corners = prepared.vertices[prepared.faces]
    areas = _areas(corners)
    if not areas.sum() > 0:
        raise InputError("a mesh without area cannot be sampled")
    face, weights = _even_samples(areas, count, rng)
    points = np.einsum("nc,nci->ni", weights, corners[face])
    normals = np.einsum("nc,nci->ni", weights, prepared.corner_normals[face])
    normals /= np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    planes = _unit_normals(corners)[face]
    uv = np.einsum("nc,nci->ni", weights, prepared.corner_uv[face])
    spacing = np.sqrt(areas.sum() / count)
    radius = DISK_FACTOR * spacing
    edges, closed = _sharp_edges(prepared)
    return {
        "points": points.T.astype(np.float32),
        "normals": normals.T.astype(np.float32),
        "planes": planes.T.astype(np.float32),
        "colors": _texture_colors(prepared, face, uv, spacing).T,
        "clips": _clips(points, planes, edges, radius).T,
        "radii": np.array(radius, np.float32),
        "scales": np.array(np.linalg.norm(np.ptp(mesh.vertices, axis=0)), np.float32),
        "closed": np.array(closed),
    }


def _unit_normals(corners: Float[np.ndarray, "F 3 3"]) -> Float[np.ndarray, "F 3"]:
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)


def _areas(corners: np.ndarray) -> Float[np.ndarray, "F"]:
    sides = corners[:, 1:] - corners[:, :1]
    return np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1) / 2


def _even_samples(
    areas: Float[np.ndarray, "F"], count: int, rng: np.random.Generator
) -> tuple[Int[np.ndarray, "N"], Float[np.ndarray, "N 3"]]:
    """Faces by systematic sampling of their areas; barycentric weights from the R2 sequence.

    Low-discrepancy points leave smaller gaps than independent ones (the R2 sequence is Roberts'
    generalisation of the golden ratio, 2018).
    """
    cumulated = np.cumsum(areas)
    marks = (np.arange(count) + rng.random()) / count * cumulated[-1]
    face = np.minimum(np.searchsorted(cumulated, marks, side="right"), len(areas) - 1)
    golden = 1.32471795724474602596
    steps = np.arange(count)[:, None] * np.array([1 / golden, 1 / golden**2])
    a, b = ((rng.random(2) + steps) % 1.0).T
    root = np.sqrt(a)
    return face, np.stack([1 - root, root * (1 - b), root * b], axis=1)


def _texture_colors(
    prepared: PreparedMesh, face: np.ndarray, uv: np.ndarray, spacing: float
) -> Float32[np.ndarray, "N 3"]:
    """Texel of each coordinate, RGB in 0 … 1, from the level whose texels are a spacing wide."""
    footprint = np.maximum(prepared.texel_density[face] * spacing, 1.0)
    level = np.minimum(np.log2(footprint).round().astype(np.int64), len(prepared.levels) - 1)
    start, height, width = prepared.levels[level].T
    column = np.minimum((uv[:, 0] % 1.0 * width).astype(np.int64), width - 1)
    row = np.minimum(((1.0 - uv[:, 1] % 1.0) * height).astype(np.int64), height - 1)
    texels = prepared.texels[start + row * width + column]
    return texels.astype(np.float32) / np.float32(255.0)


def _sharp_edges(prepared: PreparedMesh) -> tuple[Float[np.ndarray, "E 2 3"], bool]:
    """Edges where the surface ends or creases, and whether every edge joins two faces."""
    _, position = np.unique(prepared.vertices, axis=0, return_inverse=True)
    faces = position.ravel()[prepared.faces]
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    owner = np.tile(np.arange(len(faces)), 3)
    vertex = np.concatenate(
        [prepared.faces[:, [0, 1]], prepared.faces[:, [1, 2]], prepared.faces[:, [2, 0]]]
    )
    _, edge, uses = np.unique(
        np.sort(edges, axis=1), axis=0, return_inverse=True, return_counts=True
    )
    edge = edge.ravel()
    order = np.argsort(edge, kind="stable")
    starts = np.cumsum(uses) - uses
    first, last = order[starts], order[starts + uses - 1]
    normals = _unit_normals(prepared.vertices[prepared.faces])
    cosines = np.sum(normals[owner[first]] * normals[owner[last]], axis=1)
    sharp = (uses != 2) | (cosines < np.cos(np.radians(CLIP_ANGLE_DEG)))
    opposite = edges[first, 0] == edges[last, 1]
    closed = bool(((uses == 2) & opposite).all())
    return prepared.vertices[vertex[first[sharp]]], closed


def _clips(
    points: np.ndarray, normals: np.ndarray, edges: np.ndarray, radius: float
) -> Float32[np.ndarray, "N 4"]:
    """Direction in the disk's plane to the nearest sharp edge, and the distance to it."""
    clips = np.zeros((len(points), 4), np.float32)
    clips[:, 3] = 10 * radius
    if len(edges) == 0:
        return clips
    steps = np.maximum(np.ceil(np.linalg.norm(edges[:, 1] - edges[:, 0], axis=1) / (radius / 4)), 1)
    edge = np.repeat(np.arange(len(edges)), steps.astype(np.int64) + 1)
    along = np.arange(len(edge)) - np.searchsorted(edge, edge)
    part = (along / steps[edge])[:, None]
    on_edges = edges[edge, 0] * (1 - part) + edges[edge, 1] * part
    nearest = np.asarray(KDTree(on_edges).query(points, distance_upper_bound=1.5 * radius)[1])
    near = nearest < len(on_edges)
    to_edge = on_edges[nearest[near]] - points[near]
    to_edge -= np.sum(to_edge * normals[near], axis=1, keepdims=True) * normals[near]
    distance = np.linalg.norm(to_edge, axis=1, keepdims=True)
    clips[near, :3] = to_edge / np.maximum(distance, 1e-9)
    clips[near, 3:] = distance
    return clips
