"""Users' own meshes: OBJ, PLY, GLB and what else trimesh reads."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np
import trimesh

from robust6dof.errors import DataError
from robust6dof.geometry.transforms import rotation_about_y
from robust6dof.shapes.file_textures import Painted, merge, paint
from robust6dof.shapes.mesh import Material, ObjectModel, TexturedMesh

MESH_SUFFIXES = (".glb", ".gltf", ".obj", ".ply", ".stl", ".off")
"""Files taken for meshes."""
UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001}
LARGEST_M = 3.0
"""No object of this package's world is larger [m]; a larger one is in other units."""
SMALLEST_M = 0.005


def load_mesh(path: str | Path, *, unit: Literal["m", "cm", "mm"] = "m") -> TexturedMesh:
    """Read a mesh as it stands in its file, several geometries as one.

    Args:
        path: the file.
        unit: of its coordinates.

    Returns:
        the mesh [m] in the file's own frame, with its texture, or its vertices' or plain colour.

    Raises:
        DataError: no such file, not a mesh, no faces, coordinates that are not finite, or an
            implausible size.
    """
    path = Path(path)
    painted = merge([paint(geometry) for geometry in _geometries(path)])
    mesh = _without_strays(painted, UNITS[unit])
    _check(path, mesh)
    return mesh


def load_object(
    path: str | Path,
    category: str,
    *,
    up: Literal["y", "z"] = "y",
    turn_deg: float = 0.0,
    unit: Literal["m", "cm", "mm"] = "m",
) -> ObjectModel:
    """Read a mesh as an object of a category, in the canonical frame.

    Args:
        path: the file.
        category: its category; any name.
        up: the file's axis that points up; z becomes y (x stays).
        turn_deg: turn about the upward axis after that, so that handle or front is at +x.
        unit: of the file's coordinates.

    Raises:
        DataError: as `load_mesh`.
    """
    mesh = load_mesh(path, unit=unit)
    vertices = mesh.vertices @ _canonical_rotation(up, turn_deg).T
    vertices = vertices - (vertices.min(axis=0) + vertices.max(axis=0)) / 2
    turned = TexturedMesh(vertices, mesh.faces, mesh.uv, mesh.texture, mesh.material)
    return ObjectModel(turned, category, _object_name(Path(path)), {"file": Path(path).name})


def load_objects(
    folder: str | Path,
    *,
    up: Literal["y", "z"] = "y",
    unit: Literal["m", "cm", "mm"] = "m",
) -> dict[str, list[ObjectModel]]:
    """Read every mesh of FOLDER/category/file (or FOLDER/category/instance/file).

    Returns:
        category → its objects, both in the order of their names.

    Raises:
        DataError: no such folder, no meshes in it, or one that cannot be read.
    """
    root = _existing(Path(folder))
    found = {child.name: mesh_files(child) for child in sorted(root.iterdir()) if child.is_dir()}
    objects = {
        category: [load_object(path, category, up=up, unit=unit) for path in paths]
        for category, paths in found.items()
        if paths
    }
    if not objects:
        raise DataError(root, "no meshes in its subfolders", _remedy(root, "CATEGORY"))
    return objects


def load_category(
    folder: str | Path,
    category: str,
    *,
    up: Literal["y", "z"] = "y",
    unit: Literal["m", "cm", "mm"] = "m",
) -> list[ObjectModel]:
    """Read every mesh of FOLDER/category alone, by name.

    Raises:
        DataError: as `load_objects`.
    """
    return [
        load_object(path, category, up=up, unit=unit) for path in category_files(folder, category)
    ]


def category_files(folder: str | Path, category: str) -> list[Path]:
    """Mesh files of FOLDER/category, by name.

    Raises:
        DataError: no such folder, or no meshes in it.
    """
    root = _existing(Path(folder))
    child = root / category
    paths = mesh_files(child) if child.is_dir() else []
    if not paths:
        raise DataError(root, f"no meshes of category '{category}'", _remedy(root, category))
    return paths


def _existing(root: Path) -> Path:
    if not root.is_dir():
        raise DataError(root, "not a folder", "Give the folder that holds CATEGORY/MESH files")
    return root


def _remedy(root: Path, category: str) -> str:
    return f"Put files {', '.join(MESH_SUFFIXES)} into {root.name}/{category}/"


def mesh_files(folder: Path) -> list[Path]:
    """Mesh files in a folder and its direct subfolders, by name."""
    files = [*folder.iterdir(), *folder.glob("*/*")]
    return sorted(path for path in files if path.suffix.lower() in MESH_SUFFIXES)


def _geometries(path: Path) -> list[trimesh.Trimesh]:
    if not path.is_file():
        raise DataError(path, "no such file", "Check the path")
    readable = "Give a triangle mesh (GLB, OBJ, PLY)"
    try:
        with np.errstate(invalid="ignore"):
            loaded = trimesh.load_scene(path, process=False).dump()
    except Exception as error:
        raise DataError(path, f"not a readable mesh ({error})", readable) from error
    meshes = [part for part in loaded if isinstance(part, trimesh.Trimesh) and len(part.faces)]
    if not meshes:
        problem = "has points but no faces" if loaded else "holds no geometry"
        raise DataError(path, problem, readable)
    return meshes


def _without_strays(painted: Painted, scale: float) -> TexturedMesh:
    """Without vertices that no face uses: they would enlarge the box."""
    used, faces = np.unique(painted.faces, return_inverse=True)
    return TexturedMesh(
        painted.vertices[used] * scale,
        faces.reshape(-1, 3),
        painted.uv[used],
        painted.image,
        Material(),
    )


def _check(path: Path, mesh: TexturedMesh) -> None:
    if not np.isfinite(mesh.vertices).all():
        raise DataError(path, "has coordinates that are not finite", "Export the mesh again")
    largest = float(np.ptp(mesh.vertices, axis=0).max())
    if largest > LARGEST_M:
        raise DataError(
            path,
            f"is {largest:.4g} m large, so its unit is probably not the metre",
            "Scale it to metres, or give unit mm or cm",
        )
    if largest < SMALLEST_M:
        raise DataError(path, f"is only {largest:.3g} m large", "Scale it to metres")


def _canonical_rotation(up: Literal["y", "z"], turn_deg: float) -> np.ndarray:
    stand = np.eye(3) if up == "y" else np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
    return rotation_about_y(np.radians(turn_deg)) @ stand


def _object_name(path: Path) -> str:
    """The file's stem, or its folder's name where files are all called alike."""
    return path.parent.name if path.stem in ("textured", "model", "mesh") else path.stem
