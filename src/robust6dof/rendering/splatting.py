"""A z-buffer for disks on surfaces, in plain PyTorch: any device, no OpenGL.

Each point draws the pixels around it whose rays meet its disk, at the depth of the disk's plane
(surface splatting with a hard edge, after Zwicker et al., "Surface splatting", 2001).
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from jaxtyping import Bool, Float, Int
from torch import Tensor

from robust6dof.rendering.surface_samples import SurfaceSamples

_EMPTY = torch.iinfo(torch.int64).max
_NEAR_M = 0.02
MAX_REACH_PX = 3
"""A disk draws at most this many pixels to each side of its centre."""


@dataclass(frozen=True, eq=False)
class Splats:
    """What each pixel sees of the points drawn."""

    depth: Float[Tensor, "B S S"]
    """Distance along the optical axis [m]; 0 where there is nothing."""
    point: Int[Tensor, "B S S"]
    """Index of the point seen; 0 where there is nothing."""

    @property
    def seen(self) -> Bool[Tensor, "B S S"]:
        return self.depth > 0


def splat(
    samples: SurfaceSamples,
    object_index: Int[Tensor, "B"],
    T_cam_obj: Float[Tensor, "B 4 4"],
    K: Float[Tensor, "B 3 3"],
    size: int,
) -> Splats:
    """Draw one object into each of B square images of `size` pixels.

    T_cam_obj may stretch the object (any invertible affine map): its points, disks and sharp
    edges follow. The same input gives the same image on every run.
    """
    disks = _visible_disks(samples, object_index, T_cam_obj, K, size)
    reach = _reach_px(disks)
    width = size + 2 * MAX_REACH_PX
    buffer = torch.full((len(K) * width * width,), _EMPTY, dtype=torch.int64, device=K.device)
    for ring in range(int(reach.max()) + 1 if len(reach) else 0):
        # Distant disks draw nothing in the outer rings.
        part = disks if ring <= 1 else disks[:, reach >= ring]
        for dx, dy in _ring(ring):
            _draw(part, dx, dy, width, buffer)
    inner = slice(MAX_REACH_PX, MAX_REACH_PX + size)
    return _unpack(buffer.reshape(len(K), width, width)[:, inner, inner])


def _ring(radius: int) -> list[tuple[int, int]]:
    """Offsets (dx, dy) with this largest component."""
    reach = range(-radius, radius + 1)
    return [(dx, dy) for dy in reach for dx in reach if max(abs(dx), abs(dy)) == radius]


# Rows of the [16, M] table of disks: centre, ray of the nearest pixel, ray per pixel, normal,
# n · centre, plane of the sharp edge (k · x ≤ c), squared radius.
_PX, _PY, _PZ, _RX, _RY, _DX, _DY, _NX, _NY, _NZ, _NP, _KX, _KY, _KZ, _C, _R_SQ = range(16)


@dataclass(frozen=True, eq=False)
class _Disks:
    """The M points that face the camera and lie in the image, in the camera frame."""

    table: Float[Tensor, "16 M"]
    pixel: Int[Tensor, "M"]
    """Where the pixel nearest to the centre lies in the padded buffer."""
    point: Int[Tensor, "M"]

    def __getitem__(self, part: tuple[slice, Tensor]) -> _Disks:
        return _Disks(self.table[part], self.pixel[part[1]], self.point[part[1]])


def _reach_px(disks: _Disks) -> Int[Tensor, "M"]:
    """Pixels to each side that a disk may cover, its centre being half a pixel off at most."""
    radius_px = disks.table[_R_SQ].sqrt() / (disks.table[_PZ] * disks.table[_DX])
    return (radius_px + 0.5).long().clamp(max=MAX_REACH_PX)


def _visible_disks(
    samples: SurfaceSamples,
    object_index: Int[Tensor, "B"],
    T_cam_obj: Float[Tensor, "B 4 4"],
    K: Float[Tensor, "B 3 3"],
    size: int,
) -> _Disks:
    A = T_cam_obj[:, :3, :3]
    cofactor = torch.linalg.inv(A).transpose(1, 2)
    points = A @ samples.points[object_index] + T_cam_obj[:, :3, 3:]
    normals = cofactor @ samples.planes[object_index]
    clips = samples.clips[object_index]
    clip_normals = cofactor @ clips[:, :3]
    z = points[:, 2]
    facing = (normals * points).sum(1)
    column = (K[:, 0, 0, None] * points[:, 0] / z + K[:, 0, 2, None]).round_()
    row = (K[:, 1, 1, None] * points[:, 1] / z + K[:, 1, 2, None]).round_()
    visible = (z > _NEAR_M) & ((facing < 0) | ~samples.closed[object_index, None])
    low, high = -MAX_REACH_PX, size - 1 + MAX_REACH_PX
    # Points beside the image may still reach into it; the outermost column has no neighbour.
    visible &= (column > low) & (column < high) & (row > low) & (row < high)
    at = visible.flatten().nonzero().squeeze(1)
    image, point = at // z.shape[1], at % z.shape[1]

    def pick(values: Tensor) -> Tensor:
        return values.reshape(-1)[at]

    stretch = torch.linalg.vector_norm(A, dim=1).amax(dim=1)
    radius_sq = (samples.radii[object_index] * stretch) ** 2
    column, row = pick(column), pick(row)
    pitch_x, pitch_y = 1.0 / K[:, 0, 0], 1.0 / K[:, 1, 1]
    table = [
        *(pick(points[:, i]) for i in range(3)),
        (column - K[image, 0, 2]) * pitch_x[image],
        (row - K[image, 1, 2]) * pitch_y[image],
        pitch_x[image],
        pitch_y[image],
        *(pick(normals[:, i]) for i in range(3)),
        facing.flatten()[at],
        *(pick(clip_normals[:, i]) for i in range(3)),
        pick(clips[:, 3] + (clip_normals * points).sum(1)),
        radius_sq[image],
    ]
    width = size + 2 * MAX_REACH_PX
    pixel = (image * width + row.long() + MAX_REACH_PX) * width + column.long() + MAX_REACH_PX
    return _Disks(torch.stack(table), pixel, point)


def _draw(disks: _Disks, dx: int, dy: int, width: int, buffer: Tensor) -> None:
    """Draw the pixel at this offset from each disk's centre into the packed z-buffer."""
    d = disks.table
    ray_x = torch.add(d[_RX], d[_DX], alpha=dx)
    ray_y = torch.add(d[_RY], d[_DY], alpha=dy)
    z = d[_NP] / torch.addcmul(torch.addcmul(d[_NZ], d[_NX], ray_x), d[_NY], ray_y)
    clip = torch.addcmul(torch.addcmul(d[_KZ], d[_KX], ray_x), d[_KY], ray_y).mul_(z)
    distance_sq = (z - d[_PZ]).square_()
    distance_sq += ray_x.mul_(z).sub_(d[_PX]).square_()
    distance_sq += ray_y.mul_(z).sub_(d[_PY]).square_()
    hit = (distance_sq <= d[_R_SQ]) & (clip <= d[_C]) & (z > _NEAR_M)
    # Positive floats order like their bits; the low half carries the point.
    packed = (z.view(torch.int32).long() << 32).bitwise_or_(disks.point)
    packed.masked_fill_(~hit, _EMPTY)
    pixel = disks.pixel + (dy * width + dx)
    # Rays at the padding's rim may leave their own image; what they hit there is cut away.
    buffer.scatter_reduce_(0, pixel.clamp_(0, len(buffer) - 1), packed, reduce="amin")


def _unpack(buffer: Int[Tensor, "B S S"]) -> Splats:
    seen = buffer < _EMPTY
    depth = (buffer >> 32).int().view(torch.float32)
    zero = torch.zeros_like(buffer)
    return Splats(
        torch.where(seen, depth, torch.zeros_like(depth)),
        torch.where(seen, buffer & 0xFFFFFFFF, zero),
    )
