"""Print how far views of procedural objects lie from their prior, for `likeness.LARGEST_GAP`.

    python benchmarks/fit_likeness.py --shapes 200

Each object is seen once, from a random side above it, with the depth noise of a D435i-like sensor,
its pose disturbed as a good track is. Beside its own prior it is held against the others.
"""

from __future__ import annotations

import argparse

import numpy as np
from scipy.spatial.transform import Rotation

from robust6dof.frames import CATEGORIES
from robust6dof.geometry.camera import backproject
from robust6dof.geometry.transforms import make_transform, transform_points
from robust6dof.rendering.rasteriser import render_depth
from robust6dof.rendering.scene import Camera, MeshInstance, Scene
from robust6dof.shapes.mesh import ObjectModel
from robust6dof.shapes.priors import load_prior
from robust6dof.shapes.procedural import make_object
from robust6dof.tracking.likeness import CategoryShape
from robust6dof.tracking.region import depth_noise

K = np.array([[205.0, 0.0, 107.0], [0.0, 205.0, 80.0], [0.0, 0.0, 1.0]])
WIDTH, HEIGHT = 214, 160
DISTANCE_M = 0.8
ROTATION_DEG, SHIFT_M, SIZE = 3.0, 0.006, 0.03
"""Standard deviations of a good track."""


def seen_points(made: ObjectModel, rng: np.random.Generator) -> np.ndarray:
    """One view's points, in the object frame as a good track has it."""
    tilt, yaw = np.deg2rad(rng.uniform(15, 75)), rng.uniform(0, 2 * np.pi)
    away = [np.cos(tilt) * np.cos(yaw), np.sin(tilt), np.cos(tilt) * np.sin(yaw)]
    z = -np.array(away)
    x = np.cross(z, [0.0, 1.0, 0.0])
    x /= np.linalg.norm(x)
    T_obj_cam = make_transform(np.stack([x, np.cross(z, x), z], axis=1), -DISTANCE_M * z)
    scene = Scene([MeshInstance(made.mesh, np.eye(4), 1)], [])
    depth, ids = render_depth(scene, Camera(K, WIDTH, HEIGHT, T_obj_cam))
    points, _ = backproject(depth, K, ids == 1)
    points[:, 2] += rng.normal(0.0, depth_noise(DISTANCE_M), len(points))
    turn = Rotation.from_rotvec(np.deg2rad(rng.normal(0, ROTATION_DEG / np.sqrt(3), 3)))
    error = make_transform(turn.as_matrix(), rng.normal(0, SHIFT_M / np.sqrt(3), 3))
    return transform_points(error @ T_obj_cam, points)


def main() -> None:
    parser = argparse.ArgumentParser(description="Fit the likeness")
    parser.add_argument("--shapes", type=int, default=200)
    options = parser.parse_args()
    shapes = {name: CategoryShape(load_prior(name), name) for name in CATEGORIES}
    print("| seen | held against | median | 90 % | 99 % | largest |")
    for true in CATEGORIES:
        gaps: dict[str, list[float]] = {name: [] for name in CATEGORIES}
        for seed in range(options.shapes):
            rng = np.random.default_rng([seed, 7])
            made = make_object(true, seed)
            points = seen_points(made, rng)
            extents = made.extents * np.exp(rng.normal(0, SIZE))
            for name in CATEGORIES:
                gaps[name].append(shapes[name].gap(points, extents))
        for name in CATEGORIES:
            cells = [*np.percentile(gaps[name], [50, 90, 99]), max(gaps[name])]
            print(f"| {true} | {name} | " + " | ".join(f"{cell:.3f}" for cell in cells) + " |")


if __name__ == "__main__":
    main()
