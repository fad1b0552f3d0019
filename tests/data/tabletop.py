"""Loaders of the single real frames on table tops; for tests only."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from robust6dof.data.depth_unit import depth_to_metres
from robust6dof.data.image_files import read_color, read_depth, read_mask
from robust6dof.data.restricted_pickle import read_npy
from robust6dof.frames import RgbdFrame
from shared_data import shared_data

SARNET_K = np.array([[606.9066, 0, 319.9248], [0, 606.2557, 240.7983], [0, 0, 1]])
GRASPNET_OBJECTS = ("blue_mug", "green_bowl", "white_bowl", "mustard", "cylinder")


def graspnet_frame(name: str) -> tuple[RgbdFrame, np.ndarray]:
    """One RealSense frame and the object's points in the camera frame [N, 3]."""
    path = shared_data("tabletop_frames", "nv_6dof_graspnet", f"{name}.npy")
    fields = read_npy(path).item()
    depth = np.nan_to_num(fields["depth"]).astype(np.float32)
    frame = RgbdFrame(fields["image"], depth, fields["intrinsics_matrix"], name=name)
    return frame, fields["smoothed_object_pc"]


def sarnet_mug() -> tuple[RgbdFrame, np.ndarray]:
    """One D435 frame of a mug and the mug's mask."""
    folder = shared_data("tabletop_frames", "sarnet_d435_mug")
    depth = depth_to_metres(read_depth(folder / "0000_depth.png"), 0.001)
    frame = RgbdFrame(read_color(folder / "0000_image.png"), depth, SARNET_K, name="0000")
    return frame, read_mask(folder / "0000_mask.png")


def write_m3t_recording(path: Path) -> Path:
    """Two frames of colour 960×540 and depth 848×480 as a recording that `read_video` opens."""
    source = shared_data("tabletop_frames", "m3t_sequence", "_sequence")
    for folder in ("rgb", "depth"):
        (path / folder).mkdir(parents=True)
    for index in (200, 201):
        for folder, camera in (("rgb", "color"), ("depth", "depth")):
            image = source / f"{camera}_camera_image_{index}.png"
            (path / folder / f"{index}.png").write_bytes(image.read_bytes())
    np.savetxt(path / "cam_K.txt", _m3t_K(source / "color_camera.yaml"))
    np.savetxt(path / "cam_K_depth.txt", _m3t_K(source / "depth_camera.yaml"))
    np.savetxt(path / "T_color_depth.txt", _m3t_matrix(source / "depth_camera.yaml"))
    return path


def m3t_triangle() -> tuple[np.ndarray, np.ndarray]:
    """Reference `T_color_obj` of frame 200 and the vertices of the body [N, 3] in its frame."""
    folder = shared_data("tabletop_frames", "m3t_sequence")
    lines = (folder / "_body" / "triangle.obj").read_text().splitlines()
    vertices = np.array([line.split()[1:4] for line in lines if line.startswith("v ")], float)
    vertices[:, 2] -= 0.006  # geometry2body_pose of triangle.yaml
    return _m3t_matrix(folder / "_body" / "triangle_static_detector.yaml"), vertices


def _m3t_K(path: Path) -> np.ndarray:
    text = path.read_text()
    f_u, f_v, pp_x, pp_y = (
        float(re.search(rf"{key}: ([\d.]+)", text)[1]) for key in ("f_u", "f_v", "pp_x", "pp_y")
    )
    return np.array([[f_u, 0, pp_x], [0, f_v, pp_y], [0, 0, 1]])


def _m3t_matrix(path: Path) -> np.ndarray:
    numbers = path.read_text().split("data: [")[1].split("]")[0]
    return np.array(numbers.split(","), float).reshape(4, 4)
