"""Users' meshes: what a file says comes out, and what is wrong with it is said."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image
from trimesh.visual import ColorVisuals, TextureVisuals
from trimesh.visual.material import PBRMaterial

from robust6dof.errors import DataError
from robust6dof.shapes.loading import load_mesh, load_object, load_objects
from shared_data import shared_data

RED, BLUE = [255, 0, 0], [0, 0, 255]


def color_at(mesh, point: list[float]) -> np.ndarray:
    """Texture colour (nearest texel) of the face whose centre is nearest to a point."""
    centres = mesh.vertices[mesh.faces].mean(axis=1)
    face = mesh.faces[np.argmin(np.linalg.norm(centres - point, axis=1))]
    u, v = mesh.uv[face].mean(axis=0)
    rows, columns = mesh.texture.shape[:2]
    return mesh.texture[int((1 - v) * rows), int(u * columns)]


def textured_box(image: np.ndarray, uv_scale: float = 1.0) -> trimesh.Trimesh:
    """A square in the x–y plane, u along x and v along y."""
    vertices = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], float) * 0.2
    material = PBRMaterial(baseColorTexture=Image.fromarray(image))
    visual = TextureVisuals(uv=vertices[:, :2] / 0.2 * uv_scale, material=material)
    return trimesh.Trimesh(vertices, [[0, 1, 2], [0, 2, 3]], visual=visual, process=False)


def left_red_right_blue() -> np.ndarray:
    image = np.zeros((16, 16, 3), np.uint8)
    image[:, :8], image[:, 8:] = RED, BLUE
    return image


@pytest.mark.parametrize("suffix", [".obj", ".ply", ".glb"])
def test_geometry_survives_each_format(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"box{suffix}"
    trimesh.creation.box((0.1, 0.2, 0.3)).export(path)
    mesh = load_mesh(path)
    np.testing.assert_allclose(np.ptp(mesh.vertices, axis=0), [0.1, 0.2, 0.3], atol=1e-6)
    assert len(mesh.faces) == 12


def test_face_colours_of_a_ply_reach_the_texture(tmp_path: Path) -> None:
    box = trimesh.creation.box((0.1, 0.1, 0.1))
    colors = np.where(box.triangles_center[:, :1] > 0.04, [RED], [BLUE])
    box.visual = ColorVisuals(box, face_colors=colors)
    box.export(tmp_path / "box.ply")
    mesh = load_mesh(tmp_path / "box.ply")
    np.testing.assert_array_equal(color_at(mesh, [0.05, 0, 0]), RED)
    np.testing.assert_array_equal(color_at(mesh, [-0.05, 0, 0]), BLUE)


def test_texture_of_a_glb_lies_where_it_did(tmp_path: Path) -> None:
    textured_box(left_red_right_blue()).export(tmp_path / "square.glb")
    mesh = load_mesh(tmp_path / "square.glb")
    rows, columns = mesh.texture.shape[:2]
    for vertex, uv in zip(mesh.vertices, mesh.uv, strict=True):
        column = min(int(uv[0] * columns), columns - 1)
        row = min(int((1 - uv[1]) * rows), rows - 1)
        np.testing.assert_array_equal(mesh.texture[row, column], BLUE if vertex[0] > 0 else RED)


def test_geometries_are_placed_and_keep_their_colours(tmp_path: Path) -> None:
    scene = trimesh.Scene()
    plain = trimesh.creation.box((0.1, 0.1, 0.1))
    plain.visual = TextureVisuals(material=PBRMaterial(baseColorFactor=[0, 0, 255, 255]))
    scene.add_geometry(plain, transform=trimesh.transformations.translation_matrix([1, 0, 0]))
    scene.add_geometry(textured_box(np.full((16, 16, 3), RED, np.uint8), uv_scale=2.0))
    scene.export(tmp_path / "two.glb")
    mesh = load_mesh(tmp_path / "two.glb")
    assert mesh.vertices[:, 0].max() == pytest.approx(1.05)
    np.testing.assert_array_equal(color_at(mesh, [1.05, 0, 0]), BLUE)
    np.testing.assert_array_equal(color_at(mesh, [0.1, 0.1, 0]), RED)


def test_object_stands_up_centred_and_turned(tmp_path: Path) -> None:
    box = trimesh.creation.box((0.1, 0.2, 0.3))
    box.apply_translation([1, 2, 3])
    box.export(tmp_path / "box.ply")
    standing = load_object(tmp_path / "box.ply", "box", up="z")
    np.testing.assert_allclose(standing.extents, [0.1, 0.3, 0.2], atol=1e-6)
    np.testing.assert_allclose(standing.mesh.vertices.max(axis=0), standing.extents / 2, atol=1e-6)
    turned = load_object(tmp_path / "box.ply", "box", turn_deg=90)
    np.testing.assert_allclose(turned.extents, [0.3, 0.2, 0.1], atol=1e-6)


def test_turn_brings_z_to_x(tmp_path: Path) -> None:
    cone = trimesh.creation.cone(0.05, 0.2)  # its tip is at +z
    cone.export(tmp_path / "cone.ply")
    turned = load_object(tmp_path / "cone.ply", "cone", turn_deg=90).mesh.vertices
    tip = turned[np.argmin(np.hypot(turned[:, 1], turned[:, 2]) - turned[:, 0])]
    assert tip[0] == pytest.approx(0.1, abs=1e-6)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        (b"not a mesh", "not a readable mesh"),
        (b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n"
         b"property float z\nend_header\n0 0 0\n", "no faces"),
    ],
)  # fmt: skip
def test_what_is_no_mesh_is_refused(tmp_path: Path, content: bytes, said: str) -> None:
    path = tmp_path / "bad.ply"
    path.write_bytes(content)
    with pytest.raises(DataError, match=said):
        load_mesh(path)


def test_missing_file_is_said(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no such file"):
        load_mesh(tmp_path / "absent.glb")


def test_millimetres_are_suspected_and_read(tmp_path: Path) -> None:
    trimesh.creation.box((100, 80, 60)).export(tmp_path / "box.ply")
    with pytest.raises(DataError, match="unit"):
        load_mesh(tmp_path / "box.ply")
    extents = np.ptp(load_mesh(tmp_path / "box.ply", unit="mm").vertices, axis=0)
    np.testing.assert_allclose(extents, [0.1, 0.08, 0.06])


def test_coordinates_that_are_not_finite_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "bad.obj"
    path.write_text("v 0 0 0\nv 1 nan 0\nv 1 1 0\nf 1 2 3\n")
    with pytest.raises(DataError, match=r"finite|readable"):
        load_mesh(path)


def test_unused_vertices_do_not_enlarge_the_box(tmp_path: Path) -> None:
    path = tmp_path / "stray.obj"
    path.write_text("v 0 0 0\nv 0.1 0 0\nv 0.1 0.1 0\nv 2 2 2\nf 1 2 3\n")
    assert np.ptp(load_mesh(path).vertices, axis=0).max() == pytest.approx(0.1)


def test_folder_of_categories(tmp_path: Path) -> None:
    for name in ("spoon/a.ply", "spoon/b.ply", "fork/one/textured.ply"):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        trimesh.creation.box((0.1, 0.1, 0.1)).export(path)
    (tmp_path / "README.md").write_text("notes")
    loaded = load_objects(tmp_path)
    assert list(loaded) == ["fork", "spoon"]
    assert [made.name for made in loaded["spoon"]] == ["a", "b"]
    assert loaded["fork"][0].name == "one"
    assert loaded["fork"][0].category == "fork"


def test_folder_without_meshes_is_refused(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no meshes"):
        load_objects(tmp_path)
    with pytest.raises(DataError, match="not a folder"):
        load_objects(tmp_path / "absent")


def test_scanned_meshes_have_their_stated_sizes() -> None:
    folder = shared_data("meshes")
    loaded = {made.name: made for models in load_objects(folder).values() for made in models}
    with (folder / "INDEX.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(loaded) == len(rows)
    for row in rows:
        stated = [float(row[f"extent_{axis}_m"]) for axis in "xyz"]
        made = loaded[row["instance"]]
        np.testing.assert_allclose(made.extents, stated, atol=1e-4)
        assert (made.mesh.texture.size > 3) == (row["textured"] == "yes")


def test_ycb_scan_stands_and_is_textured() -> None:
    path = shared_data("ycb_meshes") / "006_mustard_bottle" / "textured.obj"
    bottle = load_object(path, "bottle", up="z")
    assert bottle.name == "006_mustard_bottle"
    np.testing.assert_allclose(bottle.extents[1], 0.191, atol=0.002)
    assert bottle.mesh.texture.reshape(-1, 3).std(axis=0).min() > 5
