"""The rasteriser against a naive ray caster, closed forms, trimesh's rays and MuJoCo."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from robust6dof.errors import InputError
from robust6dof.geometry.transforms import make_transform
from robust6dof.rendering.prepared_mesh import corner_normals
from robust6dof.rendering.rasteriser import NEAR_M, render, render_depth
from robust6dof.rendering.scene import Camera, Light, MeshInstance, Scene
from robust6dof.shapes.mesh import Material, TexturedMesh

MATT = Material(specular=0.0)
K_SMALL = np.array([[40.0, 0.3, 19.6], [0.0, 41.0, 14.2], [0.0, 0.0, 1.0]])
K_VGA = np.array([[615.0, 0.0, 319.5], [0.0, 615.0, 239.5], [0.0, 0.0, 1.0]])


def plain(vertices: np.ndarray, faces: np.ndarray | list, color=(200, 150, 100)) -> TexturedMesh:
    texture = np.array(color, np.uint8).reshape(1, 1, 3)
    uv = np.zeros((len(vertices), 2))
    return TexturedMesh(np.asarray(vertices, float), np.asarray(faces), uv, texture, MATT)


def from_trimesh(mesh: trimesh.Trimesh) -> TexturedMesh:
    return plain(np.asarray(mesh.vertices), np.asarray(mesh.faces))


def place(R: np.ndarray, *t: float) -> np.ndarray:
    return make_transform(R, np.array(t, float))


def small_camera(T_world_cam: np.ndarray | None = None) -> Camera:
    return Camera(K_SMALL, 40, 30, np.eye(4) if T_world_cam is None else T_world_cam)


def rays(camera: Camera) -> Float[np.ndarray, "H W 3"]:
    y, x = np.mgrid[: camera.height, : camera.width]
    pixels = np.stack([x, y, np.ones_like(x)], axis=-1).astype(float)
    return pixels @ np.linalg.inv(camera.K).T


def cast_naively(instances: list[MeshInstance], camera: Camera):
    """Möller–Trumbore over every pixel and triangle: depth and ids."""
    directions = rays(camera)
    depth = np.full(directions.shape[:2], np.inf)
    ids = np.zeros(directions.shape[:2], np.int32)
    T_cam_world = np.linalg.inv(camera.T_world_cam)
    for instance in instances:
        T = T_cam_world @ instance.T_world_mesh
        for a, b, c in (instance.mesh.vertices @ T[:3, :3].T + T[:3, 3])[instance.mesh.faces]:
            p = np.cross(directions, c - a)
            determinant = p @ (b - a)
            with np.errstate(divide="ignore", invalid="ignore"):
                u = (p @ -a) / determinant
                q = np.cross(-a, b - a)
                v = (directions @ q) / determinant
                z = ((c - a) @ q) / determinant
            hit = (determinant != 0) & (u >= 0) & (v >= 0) & (u + v <= 1) & (z >= NEAR_M)
            hit &= z < depth
            depth[hit], ids[hit] = z[hit], instance.instance_id
    return np.where(np.isfinite(depth), depth, 0.0), ids


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000))
def test_random_triangles_equal_the_naive_ray_caster(seed: int) -> None:
    rng = np.random.default_rng(seed)
    instances = []
    for instance_id in (1, 2, 3):
        # Corners in front of, beside and behind the camera: every kind of clipping occurs.
        vertices = rng.normal(0, 0.5, (12, 3)) + [0, 0, 0.4]
        mesh = plain(vertices, rng.integers(0, 12, (8, 3)))
        R = Rotation.random(random_state=seed).as_matrix()
        instances.append(MeshInstance(mesh, make_transform(R, rng.normal(0, 0.1, 3)), instance_id))
    R_world_cam = Rotation.from_rotvec(rng.normal(0, 0.3, 3)).as_matrix()
    camera = small_camera(make_transform(R_world_cam, rng.normal(0, 0.1, 3)))
    expected_depth, expected_ids = cast_naively(instances, camera)
    depth, ids = render_depth(Scene(instances), camera)
    np.testing.assert_array_equal(ids, expected_ids)
    np.testing.assert_allclose(depth, expected_depth, rtol=2e-7, atol=1e-6)


def test_plane_depth_is_exact() -> None:
    square = np.array([[-50, -50, 0], [50, -50, 0], [50, 50, 0], [-50, 50, 0.0]])
    R = Rotation.from_euler("xyz", [-60, 10, 5], degrees=True).as_matrix()
    instance = MeshInstance(plain(square, [[0, 1, 2], [0, 2, 3]]), place(R, 0, 0, 0.8), 7)
    camera = Camera(K_VGA, 640, 480, np.eye(4))
    depth, ids = render_depth(Scene([instance]), camera)
    normal = R[:, 2]
    directions = rays(camera)
    with np.errstate(divide="ignore"):
        expected = normal[2] * 0.8 / (directions @ normal)
    inside = (ids == 7) & (expected < 10)
    assert inside.sum() > 200_000
    np.testing.assert_allclose(depth[inside], expected[inside], atol=1e-6)


def test_sphere_depth_is_the_closed_form_up_to_its_facets() -> None:
    radius, centre = 0.1, np.array([0.02, -0.01, 0.5])
    ball = trimesh.creation.icosphere(subdivisions=5, radius=radius)
    instance = MeshInstance(from_trimesh(ball), make_transform(np.eye(3), centre), 1)
    camera = Camera(K_VGA, 640, 480, np.eye(4))
    depth, ids = render_depth(Scene([instance]), camera)
    directions = rays(camera)
    b, a = directions @ centre, np.sum(directions**2, axis=-1)
    discriminant = b**2 - a * (centre @ centre - radius**2)
    expected = (b - np.sqrt(np.maximum(discriminant, 0))) / a
    # Facets lie inside the sphere by at most their sagitta; seen at an angle that is more in z.
    facing = (discriminant > 0) & (np.sqrt(np.maximum(discriminant, 0)) / np.sqrt(a) > 0.5 * radius)
    sagitta = radius - np.linalg.norm(ball.triangles_center, axis=1).min()
    assert (ids[facing] == 1).all()
    error = depth[facing] - expected[facing]
    assert error.min() > -1e-7
    assert error.max() < 2.2 * sagitta
    assert np.mean((ids == 1) == (discriminant > 0)) > 0.999


def test_depth_agrees_with_trimesh_rays() -> None:
    mesh = trimesh.creation.torus(0.1, 0.04, 24, 16)
    R = Rotation.from_euler("xy", [50, 20], degrees=True).as_matrix()
    T_cam_mesh = place(R, 0.01, 0.02, 0.4)
    camera = small_camera()
    depth, _ = render_depth(Scene([MeshInstance(from_trimesh(mesh), T_cam_mesh, 1)]), camera)
    placed = mesh.copy().apply_transform(T_cam_mesh)
    directions = rays(camera).reshape(-1, 3)
    points, ray_index, _ = trimesh.ray.ray_triangle.RayMeshIntersector(placed).intersects_location(
        np.zeros_like(directions), directions
    )
    expected = np.full(len(directions), np.inf)
    np.minimum.at(expected, ray_index, points[:, 2])
    expected = np.where(np.isfinite(expected), expected, 0)
    np.testing.assert_allclose(depth.ravel(), expected, atol=1e-6)


def test_depth_agrees_with_mujoco_gl_where_present() -> None:
    mujoco = pytest.importorskip("mujoco")
    if not hasattr(mujoco, "Renderer"):
        pytest.skip("this MuJoCo has no OpenGL renderer")
    model = mujoco.MjModel.from_xml_string(
        """<mujoco><statistic extent="1"/><visual><map znear="0.05" zfar="5"/></visual><worldbody>
        <geom type="box" size=".1 .07 .05" pos="0 0 -.6" euler="20 30 10"/>
        <camera name="c" fovy="45"/></worldbody></mujoco>"""
    )
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    try:
        renderer = mujoco.Renderer(model, 120, 160)
    except Exception as error:
        pytest.skip(f"no OpenGL here: {error}")
    renderer.enable_depth_rendering()
    renderer.update_scene(data, "c")
    expected = np.where((z := renderer.render()) < 4, z, 0)
    focal = 60 / np.tan(np.radians(22.5))
    K = np.array([[focal, 0, 79.5], [0, focal, 59.5], [0, 0, 1]])
    T_world_geom = make_transform(data.geom_xmat[0].reshape(3, 3), data.geom_xpos[0])
    box = from_trimesh(trimesh.creation.box([0.2, 0.14, 0.1]))
    T_world_cam = np.diag([1.0, -1.0, -1.0, 1.0])
    scene = Scene([MeshInstance(box, T_world_geom, 1)])
    depth, _ = render_depth(scene, Camera(K, 160, 120, T_world_cam))
    both = (depth > 0) & (expected > 0)
    assert np.mean((depth > 0) == (expected > 0)) > 0.999
    assert np.abs(depth - expected)[both].max() < 1e-4  # GL's 24-bit depth


def test_shared_edges_leave_no_cracks_and_order_does_not_matter() -> None:
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.3)
    instance = from_trimesh(ball)
    camera = Camera(K_VGA, 640, 480, np.eye(4))
    T = place(np.eye(3), 0, 0, 0.9)
    depth, ids = render_depth(Scene([MeshInstance(instance, T, 1)]), camera)
    rows = [row[np.flatnonzero(row)[0] : np.flatnonzero(row)[-1] + 1] for row in ids if row.any()]
    assert all(row.all() for row in rows)
    # Cracks would also show the far side of the ball.
    assert depth[ids == 1].max() < 0.9
    reversed_faces = plain(np.asarray(ball.vertices), np.asarray(ball.faces)[::-1])
    again, _ = render_depth(Scene([MeshInstance(reversed_faces, T, 1)]), camera)
    np.testing.assert_array_equal(again, depth)


def test_a_surface_around_the_camera_is_cut_at_the_near_plane() -> None:
    tube = trimesh.creation.cylinder(0.05, 4.0, sections=64)
    instance = MeshInstance(from_trimesh(tube), np.eye(4), 1)
    depth, ids = render_depth(Scene([instance]), small_camera())
    assert (ids == 1).all()
    assert depth.min() >= NEAR_M
    assert depth.max() <= 2.0 + 1e-6


def test_render_is_deterministic_and_its_depth_is_that_of_the_fast_path() -> None:
    scene = _lit_ball(specular=0.5)
    camera = Camera(K_VGA, 640, 480, np.eye(4))
    first, second = render(scene, camera), render(scene, camera)
    np.testing.assert_array_equal(first.rgb, second.rgb)
    depth, ids = render_depth(scene, camera)
    np.testing.assert_array_equal(first.depth, depth)
    np.testing.assert_array_equal(first.ids, ids)


def _lit_ball(specular: float) -> Scene:
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.1)
    texture = np.full((1, 1, 3), 100, np.uint8)
    uv = np.zeros((len(ball.vertices), 2))
    mesh = TexturedMesh(
        np.asarray(ball.vertices), np.asarray(ball.faces), uv, texture, Material(specular, 30.0)
    )
    light = Light(np.array([0.6, 0.0, 0.8]), (0.8, 0.7, 0.6))
    instance = MeshInstance(mesh, place(np.eye(3), 0, 0, 0.6), 1)
    return Scene([instance], [light], ambient=(0.2, 0.2, 0.2), background=(1, 2, 3))


@pytest.mark.parametrize("specular", [0.0, 0.5])
def test_shading_of_a_sphere_is_the_closed_form(specular: float) -> None:
    scene, camera = _lit_ball(specular), Camera(K_VGA, 640, 480, np.eye(4))
    image = render(scene, camera)
    seen = image.ids == 1
    points = rays(camera)[seen] * image.depth[seen][:, None]
    normals = points - [0, 0, 0.6]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    views = -points / np.linalg.norm(points, axis=1, keepdims=True)
    towards = -scene.lights[0].direction_world
    halves = views + towards
    halves /= np.linalg.norm(halves, axis=1, keepdims=True)
    lambert = np.maximum(normals @ towards, 0)
    highlight = np.where(lambert > 0, np.maximum(np.sum(normals * halves, axis=1), 0) ** 30, 0)
    color = np.array(scene.lights[0].color)
    expected = 100 * (0.2 + lambert[:, None] * color) + 255 * specular * highlight[:, None] * color
    error = np.abs(image.rgb[seen] - np.minimum(expected, 255))
    # Smooth normals of a faceted ball are not exactly radial.
    assert np.quantile(error, 0.99) < 2.0
    assert (image.rgb[~seen] == [1, 2, 3]).all()


def test_texture_lands_where_uv_says() -> None:
    texture = np.zeros((2, 2, 3), np.uint8)
    texture[0, 0], texture[0, 1] = [255, 0, 0], [0, 255, 0]  # top left red, top right green
    texture[1, 0], texture[1, 1] = [0, 0, 255], [255, 255, 255]
    # A square facing the camera; v is up, so camera y down is v = 0.
    vertices = np.array([[-1, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0.0]])
    uv = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
    mesh = TexturedMesh(vertices, np.array([[0, 2, 1], [0, 3, 2]]), uv, texture, MATT)
    scene = Scene([MeshInstance(mesh, place(np.eye(3), 0, 0, 2.0), 1)], ambient=(1, 1, 1))
    image = render(scene, Camera(K_VGA, 640, 480, np.eye(4))).rgb
    quarter = int(615 / 4)
    np.testing.assert_allclose(image[240 - quarter, 320 - quarter], [255, 0, 0], atol=4)
    np.testing.assert_allclose(image[240 - quarter, 320 + quarter], [0, 255, 0], atol=4)
    np.testing.assert_allclose(image[240 + quarter, 320 - quarter], [0, 0, 255], atol=4)
    np.testing.assert_allclose(image[240 + quarter, 320 + quarter], [255, 255, 255], atol=4)


def test_texture_interpolation_is_perspective_correct() -> None:
    ramp = np.repeat(np.arange(256, dtype=np.uint8)[None, :, None], 3, axis=2)
    vertices = np.array([[0, -1, 0], [3, -1, 0], [3, 1, 0], [0, 1, 0.0]])
    uv = np.array([[0, 0], [1, 0], [1, 1], [0, 1.0]])
    mesh = TexturedMesh(vertices, np.array([[0, 1, 2], [0, 2, 3]]), uv, ramp, MATT)
    R = Rotation.from_euler("y", -70, degrees=True).as_matrix()
    T = place(R, -0.3, 0, 0.8)
    scene = Scene([MeshInstance(mesh, T, 1)], ambient=(1, 1, 1))
    camera = Camera(K_VGA, 640, 480, np.eye(4))
    image = render(scene, camera)
    points_mesh = (rays(camera) * image.depth[..., None] - T[:3, 3]) @ R
    expected = points_mesh[..., 0] / 3 * 256 - 0.5
    inside = (image.ids == 1) & (expected > 4) & (expected < 250)
    assert inside.sum() > 10_000
    assert np.abs(image.rgb[..., 0] - expected)[inside].max() < 2.5


def test_back_faces_are_drawn_and_lit() -> None:
    vertices = np.array([[-1, -1, 1], [1, -1, 1], [0, 1, 1.0]])
    light = Light(np.array([0.0, 0.0, 1.0]), (0.5, 0.5, 0.5))
    images = []
    for faces in ([[0, 1, 2]], [[0, 2, 1]]):
        scene = Scene([MeshInstance(plain(vertices, faces), np.eye(4), 1)], [light])
        images.append(render(scene, small_camera()).rgb)
    np.testing.assert_array_equal(images[0], images[1])
    np.testing.assert_allclose(images[0][15, 20], [180, 135, 90], atol=1)


def test_a_box_keeps_its_edges_sharp_and_a_cylinder_is_smooth() -> None:
    box = trimesh.creation.box([1, 1, 1])
    normals = corner_normals(np.asarray(box.vertices), np.asarray(box.faces))
    np.testing.assert_allclose(normals, np.repeat(box.face_normals[:, None], 3, 1), atol=1e-6)
    tube = trimesh.creation.cylinder(1.0, 2.0, sections=60)
    normals = corner_normals(np.asarray(tube.vertices), np.asarray(tube.faces))
    corners = np.asarray(tube.vertices)[np.asarray(tube.faces)]
    on_side = np.abs(tube.face_normals[:, 2]) < 0.5
    np.testing.assert_allclose(normals[on_side], corners[on_side] * [1, 1, 0], atol=1e-3)


def test_nothing_in_view_gives_background() -> None:
    behind = plain(np.array([[-1, -1, -1], [1, -1, -1], [0, 1, -1.0]]), [[0, 1, 2]])
    image = render(Scene([MeshInstance(behind, np.eye(4), 3)]), small_camera())
    assert not image.depth.any()
    assert not image.ids.any()
    assert (image.rgb == 128).all()
    assert (render(Scene([]), small_camera()).rgb == 128).all()


def test_a_crop_of_the_camera_is_the_crop_of_its_image() -> None:
    scene, camera = _lit_ball(specular=0.5), Camera(K_VGA, 640, 480, np.eye(4))
    whole = render(scene, camera)
    K_crop = K_VGA.copy()
    K_crop[:2, 2] -= [250, 180]  # the principal point is outside this image
    crop = render(scene, Camera(K_crop, 64, 48, np.eye(4)))
    np.testing.assert_array_equal(crop.ids, whole.ids[180:228, 250:314])
    np.testing.assert_allclose(crop.depth, whole.depth[180:228, 250:314], atol=1e-6)
    assert np.abs(crop.rgb.astype(int) - whole.rgb[180:228, 250:314]).max() <= 1


def test_unusable_input_is_refused() -> None:
    vertices = np.array([[-1, -1, 1], [1, -1, 1], [0, 1, 1.0]])
    bad = Scene([MeshInstance(plain(vertices, [[0, 1, 3]]), np.eye(4), 1)])
    with pytest.raises(InputError, match="vertices 0 to 3, but it has 3"):
        render(bad, small_camera())
    unnumbered = Scene([MeshInstance(plain(vertices, [[0, 1, 2]]), np.eye(4), 0)])
    with pytest.raises(InputError, match="instance_id"):
        render(unnumbered, small_camera())
    with pytest.raises(InputError, match="intrinsics"):
        render(Scene([]), Camera(K_VGA.T.copy(), 640, 480, np.eye(4)))
