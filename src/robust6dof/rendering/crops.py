"""A renderer for training on GPUs: object crops with colour, depth, mask and coordinates.

The shipped training draws its pairs with the rasteriser (`synthetic.close_up`) instead.
Plain PyTorch on any device: dense surface samples are splatted through a z-buffer, shaded per
pixel (Lambert and Blinn-Phong, as the rasteriser), and set on a table before a background.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
import torch.nn.functional as F
from jaxtyping import Bool, Float, Int
from torch import Tensor

from robust6dof.rendering.splatting import splat
from robust6dof.rendering.surface_samples import SurfaceSamples

_GREY = 0.5


@dataclass(frozen=True, eq=False)
class CropScene:
    """What B crops show. Everything is in the camera frame of its crop."""

    object_index: Int[Tensor, "B"]
    """Which of the samples' objects is the target."""
    T_cam_obj: Float[Tensor, "B 4 4"]
    """Its pose; any invertible affine map, so that shapes may be stretched."""
    K: Float[Tensor, "B 3 3"]
    """Intrinsics of the crop [px]."""
    light_direction_cam: Float[Tensor, "B L 3"]
    """Unit vectors from the lights towards the scene."""
    light_color: Float[Tensor, "B L 3"]
    ambient: Float[Tensor, "B 3"]
    specular: Float[Tensor, "B"]
    """Strength of the highlight (`Material.specular`)."""
    shininess: Float[Tensor, "B"]
    occluder_index: Int[Tensor, "B Q"] | None = None
    """Other objects in the crop; a negative index is none."""
    T_cam_occluder: Float[Tensor, "B Q 4 4"] | None = None
    plane_cam: Float[Tensor, "B 4"] | None = None
    """A table: unit normal n towards the camera and offset d with n · x = d [m]; n = 0 is none."""
    plane_texture: Float[Tensor, "B 3 Th Tw"] | None = None
    """Colours of the table, 0 … 1; grey if there is none."""
    plane_texture_m: float = 0.5
    """Side of one repeat of the table's texture [m]."""
    background: Float[Tensor, "B 3 S S"] | None = None
    """Colours behind everything, 0 … 1; grey if there is none. It has no depth."""


@dataclass(frozen=True, eq=False)
class Crops:
    """B exact crops."""

    rgb: Float[Tensor, "B 3 S S"]
    """Colour, 0 … 1."""
    depth: Float[Tensor, "B S S"]
    """Distance along the optical axis [m]; 0 where there is nothing."""
    mask: Bool[Tensor, "B S S"]
    """Pixels that see the target."""
    canonical: Float[Tensor, "B 3 S S"]
    """Canonical (NOCS) coordinates about 0 of the target's pixels: object point / scale; else 0."""
    visibility: Float[Tensor, "B"]
    """Visible pixels over those that would be seen without occluders and table; 0 if none."""


@dataclass(frozen=True, eq=False)
class _Layer:
    """A surface per pixel: where it is, what colour it has and how it is turned."""

    depth: Float[Tensor, "B S S"]
    albedo: Float[Tensor, "B 3 S S"]
    normal: Float[Tensor, "B 3 S S"]

    def behind(self, front: _Layer) -> tuple[_Layer, Bool[Tensor, "B S S"]]:
        """This layer with another one before it, and where that other one is seen."""
        nearer = (front.depth > 0) & ((self.depth == 0) | (front.depth < self.depth))
        merged = _Layer(
            torch.where(nearer, front.depth, self.depth),
            torch.where(nearer[:, None], front.albedo, self.albedo),
            torch.where(nearer[:, None], front.normal, self.normal),
        )
        return merged, nearer


def render_crops(samples: SurfaceSamples, scene: CropScene, size: int) -> Crops:
    """Draw B crops of size × size pixels.

    Depth and mask agree with the exact rasteriser (median depth error below 1 mm off the edges,
    mask IoU above 0.97) while the samples lie at most about a pixel apart.
    """
    rays = pixel_rays(scene.K, size)
    target = _object_layer(samples, scene.object_index, scene.T_cam_obj, scene.K, size)
    around = _surroundings(samples, scene, size, rays)
    merged, mask = around.behind(target)
    rgb = _shade(merged, scene, rays)
    if scene.plane_cam is not None:
        shadow = _plane_shadow(samples, scene, scene.plane_cam, size)
        rgb = torch.where(mask[:, None], rgb, rgb * (1 - shadow[:, None]))
    background = torch.full_like(rgb, _GREY) if scene.background is None else scene.background
    rgb = torch.where((merged.depth > 0)[:, None], rgb, background)
    whole = (target.depth > 0).sum(dim=(1, 2))
    visibility = mask.sum(dim=(1, 2)) / whole.clamp(min=1)
    canonical = _canonical(samples, scene, merged.depth, rays) * mask[:, None]
    return Crops(rgb.clamp(0, 1), merged.depth, mask, canonical, visibility)


def pixel_rays(K: Float[Tensor, "B 3 3"], size: int) -> Float[Tensor, "B 3 S S"]:
    """Ray (z = 1) of each pixel centre."""
    steps = torch.arange(size, device=K.device, dtype=K.dtype)
    x = (steps - K[:, 0, 2, None]) / K[:, 0, 0, None]
    y = (steps - K[:, 1, 2, None]) / K[:, 1, 1, None]
    x, y = x[:, None, :].expand(-1, size, -1), y[:, :, None].expand(-1, -1, size)
    return torch.stack([x, y, torch.ones_like(x)], dim=1)


def _object_layer(
    samples: SurfaceSamples,
    object_index: Int[Tensor, "B"],
    T_cam_obj: Float[Tensor, "B 4 4"],
    K: Float[Tensor, "B 3 3"],
    size: int,
) -> _Layer:
    splats = splat(samples, object_index, T_cam_obj, K, size)
    at = object_index[:, None, None]
    albedo = samples.colors[at, :, splats.point].permute(0, 3, 1, 2)
    normal_obj = samples.normals[at, :, splats.point].flatten(1, 2)
    # Normals transform with the inverse transpose: as rows, times the inverse.
    normal = (normal_obj @ torch.linalg.inv(T_cam_obj[:, :3, :3])).transpose(1, 2)
    normal = F.normalize(normal, dim=1).unflatten(2, (size, size))
    return _Layer(splats.depth, albedo, normal)


def _surroundings(
    samples: SurfaceSamples, scene: CropScene, size: int, rays: Float[Tensor, "B 3 S S"]
) -> _Layer:
    """Table and occluders, without the target."""
    layer = _plane_layer(scene, rays)
    if scene.occluder_index is not None and scene.T_cam_occluder is not None:
        for q in range(scene.occluder_index.shape[1]):
            index, T_cam_occluder = scene.occluder_index[:, q], scene.T_cam_occluder[:, q]
            front = _object_layer(samples, index.clamp(min=0), T_cam_occluder, scene.K, size)
            depth = front.depth * (index >= 0)[:, None, None]
            layer, _ = layer.behind(_Layer(depth, front.albedo, front.normal))
    return layer


def _plane_layer(scene: CropScene, rays: Float[Tensor, "B 3 S S"]) -> _Layer:
    if scene.plane_cam is None:
        nothing = torch.zeros_like(rays)
        return _Layer(nothing[:, 0], nothing, nothing)
    normal, offset = scene.plane_cam[:, :3], scene.plane_cam[:, 3]
    along = (normal[:, :, None, None] * rays).sum(1)
    depth = torch.where(along < -1e-3, offset[:, None, None] / along, torch.zeros_like(along))
    depth = torch.where((depth > 0) & (depth < 10.0), depth, torch.zeros_like(depth))
    albedo = torch.full_like(rays, _GREY)
    if scene.plane_texture is not None:
        albedo = _plane_colors(scene.plane_texture, normal, rays * depth[:, None], scene)
    return _Layer(depth, albedo, normal[:, :, None, None].expand_as(rays))


def _plane_colors(
    texture: Float[Tensor, "B 3 Th Tw"],
    normal: Float[Tensor, "B 3"],
    points: Float[Tensor, "B 3 S S"],
    scene: CropScene,
) -> Float[Tensor, "B 3 S S"]:
    """Texture in two directions of the plane, mirrored from repeat to repeat."""
    x_axis = torch.tensor([1.0, 0.0, 0.0], device=normal.device).expand_as(normal)
    side = F.normalize(torch.linalg.cross(normal, x_axis) + 1e-9, dim=1)
    other = torch.linalg.cross(normal, side)
    u = (side[:, :, None, None] * points).sum(1) / scene.plane_texture_m
    v = (other[:, :, None, None] * points).sum(1) / scene.plane_texture_m
    grid = torch.stack([u, v], dim=-1) % 4.0
    grid = 1.0 - (grid - 2.0).abs()  # a triangle wave from −1 to 1
    return F.grid_sample(texture, grid, padding_mode="border", align_corners=False)


def _shade(
    layer: _Layer, scene: CropScene, rays: Float[Tensor, "B 3 S S"]
) -> Float[Tensor, "B 3 S S"]:
    """albedo · (ambient + Σ light · max(n·l, 0)) + specular · Σ light · max(n·h, 0)^s."""
    size = layer.depth.shape[1:]
    view = -F.normalize(rays, dim=1).flatten(2)
    normal = layer.normal.flatten(2)
    along_view = (normal * view).sum(1)
    turned = torch.where(along_view < 0, -1.0, 1.0)  # towards the camera
    along_view = along_view.abs()
    diffuse = scene.ambient[:, :, None].expand_as(normal)
    gloss = torch.zeros_like(normal)
    for i in range(scene.light_color.shape[1]):
        towards, color = -scene.light_direction_cam[:, i, None], scene.light_color[:, i, :, None]
        lambert = (towards @ normal)[:, 0] * turned
        half_length = (2.0 + 2.0 * (towards @ view)[:, 0]).clamp(min=1e-6).sqrt()
        along_half = ((along_view + lambert) / half_length).clamp(0.0, 1.0)
        highlight = along_half ** scene.shininess[:, None] * (lambert > 0)
        diffuse = diffuse + lambert.clamp(min=0)[:, None] * color
        gloss = gloss + highlight[:, None] * (color * scene.specular[:, None, None])
    return layer.albedo * diffuse.unflatten(2, size) + gloss.unflatten(2, size)


def _plane_shadow(
    samples: SurfaceSamples, scene: CropScene, plane_cam: Float[Tensor, "B 4"], size: int
) -> Float[Tensor, "B S S"]:
    """How much of its light the table loses to the target, 0 … 0.6: its points along light 0.

    Soft and without regard to what lies between: a cue of contact, not a shadow volume.
    """
    normal, offset = plane_cam[:, :3], plane_cam[:, 3]
    light = scene.light_direction_cam[:, 0]
    points = scene.T_cam_obj[:, :3, :3] @ samples.points[scene.object_index][:, :, ::4]
    points = points + scene.T_cam_obj[:, :3, 3:]
    height = (normal[:, :, None] * points).sum(1) - offset[:, None]
    sinking = (normal * light).sum(1, keepdim=True).clamp(max=-0.1)
    onto_plane = points - light[:, :, None] * (height / sinking)[:, None]
    pixels = scene.K[:, :2] @ (onto_plane / onto_plane[:, 2:].clamp(min=0.05))
    coarse = -(-size // 4)
    column, row = (pixels / 4).round().long().clamp(-1, coarse).unbind(1)
    padded = (row + 1) * (coarse + 2) + column + 1
    hit = torch.zeros(len(points), (coarse + 2) ** 2, device=points.device)
    hit.scatter_(1, padded, 1.0)
    hit = hit.unflatten(1, (1, coarse + 2, coarse + 2))[..., 1:-1, 1:-1]
    soft = F.avg_pool2d(hit, 3, 1, 1)
    soft = F.interpolate(soft, size=(size, size), mode="bilinear", align_corners=False)
    return 0.6 * soft[:, 0] * (normal.norm(dim=1) > 0.5)[:, None, None]


def _canonical(
    samples: SurfaceSamples,
    scene: CropScene,
    depth: Float[Tensor, "B S S"],
    rays: Float[Tensor, "B 3 S S"],
) -> Float[Tensor, "B 3 S S"]:
    """Pixels lifted by their depth, brought into the object frame and divided by its diagonal."""
    points_cam = (rays * depth[:, None]).flatten(2) - scene.T_cam_obj[:, :3, 3:]
    points_obj = torch.linalg.inv(scene.T_cam_obj[:, :3, :3]) @ points_cam
    scales = samples.scales[scene.object_index]
    return (points_obj / scales[:, None, None]).unflatten(2, depth.shape[1:])
