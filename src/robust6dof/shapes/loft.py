"""Closed solids from stacked rings: lathe profiles, swept handles, rounded boxes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Float, Int

from robust6dof.shapes.atlas import Slot


@dataclass(frozen=True, eq=False)
class Part:
    """A closed surface, faces counter-clockwise from outside, with texture coordinates.

    Vertices are doubled where the texture has a seam.
    """

    vertices: Float[np.ndarray, "V 3"]
    faces: Int[np.ndarray, "F 3"]
    uv: Float[np.ndarray, "V 2"]

    def moved(
        self, R: Float[np.ndarray, "3 3"], t: Sequence[float] | Float[np.ndarray, "3"] = (0, 0, 0)
    ) -> Part:
        """Rotated by R, then shifted by t [m]."""
        return Part(self.vertices @ R.T + np.asarray(t, dtype=float), self.faces, self.uv)


@dataclass(frozen=True, eq=False)
class Strip:
    """Successive rings of K points that share one image of the texture."""

    rings: Float[np.ndarray, "R K 3"]
    slot: Slot
    mapping: Literal["unrolled", "planar"] = "unrolled"
    """unrolled: u around the ring, v along the rings by arc length.
    planar: u and v are the ring's own x and y over their range (ends of an extrusion)."""
    mirrored: bool = False
    """Planar only: u against x, for a face seen from −z."""


def loft(strips: Sequence[Strip]) -> Part:
    """Join strips into a closed part; the first and the last ring must be single points.

    Rings go counter-clockwise about the way the strips advance. Consecutive strips share a ring.
    """
    vertices, faces, uv, count = [], [], [], 0
    for strip in strips:
        closed = np.concatenate([strip.rings, strip.rings[:, :1]], axis=1)
        vertices.append(closed.reshape(-1, 3))
        uv.append(strip.slot.place(_local_uv(strip, closed)).reshape(-1, 2))
        faces.append(_grid_faces(strip.rings) + count)
        count += closed.shape[0] * closed.shape[1]
    return Part(np.concatenate(vertices), np.concatenate(faces), np.concatenate(uv))


def _grid_faces(rings: Float[np.ndarray, "R K 3"]) -> Int[np.ndarray, "F 3"]:
    """Two triangles per cell; one where a ring is a point."""
    count, size = rings.shape[:2]
    index = np.arange(count * (size + 1)).reshape(count, size + 1)
    a, b = index[:-1, :-1], index[:-1, 1:]
    d, c = index[1:, :-1], index[1:, 1:]
    point = np.ptp(rings, axis=1).max(axis=1) == 0
    lower = np.stack([a, b, c], axis=-1)[~point[:-1]].reshape(-1, 3)
    upper = np.stack([a, c, d], axis=-1)[~point[1:]].reshape(-1, 3)
    return np.concatenate([lower, upper])


def _local_uv(strip: Strip, closed: Float[np.ndarray, "R L 3"]) -> Float[np.ndarray, "R L 2"]:
    if strip.mapping == "planar":
        flat = closed[..., :2]
        low, high = flat.min(axis=(0, 1)), flat.max(axis=(0, 1))
        local = (flat - low) / (high - low)
        return local * [-1, 1] + [1, 0] if strip.mirrored else local
    steps = np.linalg.norm(np.diff(closed, axis=0), axis=2).mean(axis=1)
    v = np.concatenate([[0.0], np.cumsum(steps)])
    around = np.linalg.norm(np.diff(closed, axis=1), axis=2).sum(axis=0)
    u = np.concatenate([[0.0], np.cumsum(around)])
    grid = np.meshgrid(u / u[-1], v / v[-1])
    return np.stack(grid, axis=-1)


def rounded(
    corners: Float[np.ndarray, "N 2"], radii: float | Sequence[float], steps: int = 4
) -> Float[np.ndarray, "M 2"]:
    """An open polyline whose inner corners are replaced by curves of about the given radii [m].

    Each curve is a quadratic Bézier that takes at most 45 % of the edges beside it.
    """
    inner = np.broadcast_to(np.asarray(radii, dtype=float), (len(corners) - 2,))
    before, corner, after = corners[:-2], corners[1:-1], corners[2:]
    to_before, to_after = before - corner, after - corner
    len_before = np.linalg.norm(to_before, axis=1)
    len_after = np.linalg.norm(to_after, axis=1)
    cut = np.minimum(inner, 0.45 * np.minimum(len_before, len_after))
    start = corner + to_before * (cut / len_before)[:, None]
    end = corner + to_after * (cut / len_after)[:, None]
    t = np.linspace(0.0, 1.0, steps + 1)[None, :, None]
    curves = (1 - t) ** 2 * start[:, None] + 2 * t * (1 - t) * corner[:, None] + t**2 * end[:, None]
    points = np.concatenate([corners[:1], curves.reshape(-1, 2), corners[-1:]])
    keep = np.linalg.norm(np.diff(points, axis=0), axis=1) > 1e-6
    return points[np.concatenate([[True], keep])]


def superellipse(
    count: int, exponent: float | Float[np.ndarray, "*r"] = 2.0
) -> Float[np.ndarray, "*r count 2"]:
    """Points on |x|ⁿ + |y|ⁿ = 1 at even angles: 2 is a circle, 4 and more squarish."""
    angle = np.arange(count) * (2 * np.pi / count)
    cosine, sine = np.cos(angle), np.sin(angle)
    n = np.asarray(exponent, dtype=float)[..., None]
    radius = (np.abs(cosine) ** n + np.abs(sine) ** n) ** (-1.0 / n)
    return np.stack([radius * cosine, radius * sine], axis=-1)


@dataclass(frozen=True)
class Section:
    """What a lathe's circle becomes: squarer, wider along x than z, fluted."""

    exponent: float = 2.0
    aspect: float = 1.0
    """Depth along z over width along x."""
    flutes: int = 0
    flute_depth: float = 0.0
    """Depth of the waves around, of the radius."""
    round_radius: float = 0.0
    """Up to this radius [m] (a neck) the section stays a circle."""
    full_radius: float = 0.0
    """From this radius [m] on (the body) the section is as given."""

    def rings(
        self, profile: Float[np.ndarray, "R 2"], count: int
    ) -> Float[np.ndarray, "R count 3"]:
        """Rings of a profile of (radius, height) about the y axis."""
        radius, height = profile[:, 0], profile[:, 1]
        width = max(self.full_radius - self.round_radius, 1e-9)
        blend = np.clip((radius - self.round_radius) / width, 0.0, 1.0)
        blend = blend * blend * (3 - 2 * blend)
        shape = superellipse(count, 2.0 + blend * (self.exponent - 2.0))
        angle = np.arange(count) * (2 * np.pi / count)
        wave = 1 + np.outer(blend, self.flute_depth * (np.cos(self.flutes * angle) - 1) / 2)
        depth = 1 + blend * (self.aspect - 1)
        x = radius[:, None] * shape[..., 0] * wave
        z = -radius[:, None] * shape[..., 1] * wave * depth[:, None]
        y = np.broadcast_to(height[:, None], x.shape)
        return np.stack([x, y, z], axis=-1)


ROUND = Section()


def revolve(
    bands: Sequence[tuple[Float[np.ndarray, "_ 2"], Slot]],
    section: Section = ROUND,
    count: int = 48,
) -> Part:
    """Turn a profile, given in bands of (radius, height) points [m], about the y axis.

    The whole profile starts and ends at radius 0 and keeps the solid on its left (it goes up the
    outside).
    """
    return loft([Strip(section.rings(points, count), slot) for points, slot in bands])


def sweep(
    path: Float[np.ndarray, "N 3"],
    widths: Float[np.ndarray, "N 2"],
    slot: Slot,
    exponent: float = 2.0,
    count: int = 16,
) -> Part:
    """A tube along a path in the x–y plane; closed by flat ends.

    Args:
        path: centre line [m], z = 0.
        widths: half thickness of the section in the plane, and along z [m].
        slot: where its image lies.
        exponent: superellipse exponent of the section.
        count: points of the section.
    """
    tangent = np.gradient(path, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    normal = np.stack([tangent[:, 1], -tangent[:, 0], np.zeros(len(path))], axis=1)
    shape = superellipse(count, exponent)
    rings = (
        path[:, None]
        + (widths[:, :1] * shape[:, 0])[..., None] * normal[:, None]
        - (widths[:, 1:] * shape[:, 1])[..., None] * np.array([0.0, 0.0, 1.0])
    )
    ends = [np.repeat(path[[i], None], count, axis=1) for i in (0, -1)]
    return loft([Strip(np.concatenate([ends[0], rings, ends[1]]), slot)])


def rounded_rectangle(
    width: float, height: float, radius: float, steps: int = 4
) -> Float[np.ndarray, "K 2"]:
    """Outline counter-clockwise about the origin [m]; always 4 · (steps + 1) points."""
    radius = min(radius, 0.499 * min(width, height))
    angle = np.linspace(0.0, np.pi / 2, steps + 1)
    corners = []
    for turn, (sx, sy) in enumerate([(1, 1), (-1, 1), (-1, -1), (1, -1)]):
        centre = [sx * (width / 2 - radius), sy * (height / 2 - radius)]
        arc = angle + turn * np.pi / 2
        corners.append(centre + radius * np.stack([np.cos(arc), np.sin(arc)], axis=1))
    return np.concatenate(corners)


def box(
    size: tuple[float, float, float],
    radius: float,
    bevel: float,
    slots: Slot | tuple[Slot, Slot, Slot],
    steps: int = 4,
) -> Part:
    """A box [m] about the origin, its outline (x, y) rounded by radius and its edges bevelled.

    Args:
        size: along x, y and z.
        radius: of the outline's corners.
        bevel: of the edges around front (+z) and back.
        slots: images of front, side and back, or one for all; the front's is upright seen from +z.
        steps: pieces of each rounded corner.
    """
    front, side, back = slots if isinstance(slots, tuple) else (slots, slots, slots)
    width, height, depth = size
    bevel = min(bevel, 0.45 * depth, 0.2 * width, 0.2 * height)
    turn = np.linspace(0.0, np.pi / 2, 4)
    insets, offsets = bevel * (1 - np.sin(turn)), bevel * (1 - np.cos(turn))
    edge = [
        np.column_stack(
            [
                rounded_rectangle(width - 2 * a, height - 2 * a, max(radius - a, 1e-4), steps),
                np.full(4 * (steps + 1), -depth / 2 + b),
            ]
        )
        for a, b in zip(insets, offsets, strict=True)
    ]
    mirror = [ring * [1, 1, -1] for ring in reversed(edge)]
    bottom = np.zeros_like(edge[0]) + [0, 0, -depth / 2]
    return loft(
        [
            Strip(np.stack([bottom, edge[0]]), back, "planar", mirrored=True),
            Strip(np.stack([*edge, *mirror]), side),
            Strip(np.stack([mirror[-1], bottom * [1, 1, -1]]), front, "planar"),
        ]
    )
