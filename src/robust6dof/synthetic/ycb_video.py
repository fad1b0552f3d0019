"""YCB-Video, re-rendered: real camera trajectories and scanned shapes through our renderer.

The motion is that of the test videos' ground truth and the shapes are scans, so neither was made
here; light, table and sensor are ours. Scores on it never stand beside scores on the real images
without saying so.
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import trimesh
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from robust6dof.data.sequence_writer import SequenceWriter
from robust6dof.data.truth_file import FILE_NAME, AnnotatedTruth, write_truth_file
from robust6dof.data.ycb_video import K_FIRST, read_keyframes
from robust6dof.frames import YCB_OBJECTS
from robust6dof.geometry.transforms import invert_transform, transform_points
from robust6dof.rendering.rasteriser import render, render_depth
from robust6dof.rendering.scene import Camera, Light, MeshInstance, Rendering, Scene
from robust6dof.rendering.sensor import StereoSensor, StereoSensorConfig
from robust6dof.shapes.mesh import Material, TexturedMesh
from robust6dof.shapes.textures import any_pattern
from robust6dof.synthetic.support_plane import find_support
from robust6dof.synthetic.whole_recording import is_made, making
from robust6dof.synthetic.ycb_source import YcbSource, YcbVideoPlan

VERSION = "0.1"
RATE_HZ = 30.0
WIDTH, HEIGHT = 640, 480
_TABLE_ID = len(YCB_OBJECTS) + 1


def render_ycb_video(plan: YcbVideoPlan, source: YcbSource, out: Path) -> Path:
    """Write one video as a recording with `ground_truth.jsonl`; a whole one is kept."""
    folder, text = out / plan.video, json.dumps(vars(plan) | {"version": VERSION}) + "\n"
    if is_made(folder, text):
        return folder
    video = RerenderedVideo(plan, source)
    with making(folder, text) as place:
        writer, truths = SequenceWriter(place), []
        for index in range(len(plan.frames)):
            truths += video.write_frame(index, writer)
        write_truth_file(place / FILE_NAME, truths)
    return folder


def write_models(plans: Sequence[YcbVideoPlan], source: YcbSource, out: Path) -> None:
    """Points for ADD beside the recordings, meshes for the tracker that is given one, and the
    benchmark's keyframes where all of them are rendered."""
    _write_keyframes(plans, source.poses, out)
    for folder in ("models_points", "models"):
        (out / folder).mkdir(parents=True, exist_ok=True)
    for name in sorted({name for plan in plans for name in plan.objects}):
        shutil.copyfile(source.model_points(name), out / "models_points" / f"{name}.xyz")
        path = out / "models" / f"{name}.ply"
        if not path.is_file():
            mesh = source.mesh(name)
            trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).export(path)


def _write_keyframes(plans: Sequence[YcbVideoPlan], poses: Path, out: Path) -> None:
    path = out / "image_sets" / "keyframe.txt"
    path.unlink(missing_ok=True)
    if any(np.diff(plan.frames).max(initial=1) > 1 for plan in plans):
        return
    if not (poses / "image_sets" / "keyframe.txt").is_file():
        return
    keyframes = read_keyframes(poses)
    lines = [
        f"{plan.video}/{name}\n"
        for plan in plans
        for name in keyframes.get(plan.video, ())
        if int(name) in plan.frames
    ]
    path.parent.mkdir(exist_ok=True)
    path.write_text("".join(lines))


class RerenderedVideo:
    """One video's objects at their true poses, on a table, in a light of its own."""

    def __init__(self, plan: YcbVideoPlan, source: YcbSource) -> None:
        rng = np.random.default_rng([plan.seed, int(plan.video)])
        self.plan = plan
        self._poses = {
            name: _transforms(rows) for name, rows in source.trajectories()[plan.video].items()
        }
        self._meshes = {name: source.mesh(name) for name in plan.objects}
        self._bounds = {name: _bounds(source.model_points(name)) for name in plan.objects}
        self._sensor = StereoSensor(StereoSensorConfig.d435i().drawn(rng))
        self._table = MeshInstance(_table_mesh(rng), self._find_table(), _TABLE_ID)
        self._lights = _draw_lights(rng, self._table.T_world_mesh[:3, :3])
        self._ambient = float(rng.uniform(0.25, 0.5))

    def write_frame(self, index: int, writer: SequenceWriter) -> list[AnnotatedTruth]:
        """Render, measure, write with masks; returns the truth about each object."""
        number = self.plan.frames[index]
        T_cam_world = self._T_cam_world(number)
        camera = Camera(K_FIRST, WIDTH, HEIGHT, np.eye(4))
        instances = [
            MeshInstance(self._meshes[name], self._poses[name][number - 1], 1 + i)
            for i, name in enumerate(self.plan.objects)
        ]
        rendering = render(self._scene(instances, T_cam_world), camera)
        frame = self._sensor.observe(
            rendering,
            camera,
            np.random.default_rng([self.plan.seed, int(self.plan.video), number]),
            camera_twist=self._twist(number),
            stamp=(number - 1) / RATE_HZ,
            name=f"{number:06d}",
        )
        writer.add(frame)
        truths = []
        for instance, name in zip(instances, self.plan.objects, strict=True):
            mask = rendering.ids == instance.instance_id
            writer.add_mask(frame.name, name, mask)
            truths.append(self._truth(name, number, _visibility(instance, rendering, camera)))
        return truths

    def _T_cam_world(self, number: int) -> Float[np.ndarray, "4 4"]:
        """The world is the frame of the first object: the things stand still to each other."""
        return self._poses[self.plan.objects[0]][number - 1]

    def _scene(self, instances: list[MeshInstance], T_cam_world: np.ndarray) -> Scene:
        table = replace(self._table, T_world_mesh=T_cam_world @ self._table.T_world_mesh)
        lights = [
            replace(light, direction_world=T_cam_world[:3, :3] @ light.direction_world)
            for light in self._lights
        ]
        level = self._ambient
        return Scene([*instances, table], lights, (level, level, level), (90, 90, 95))

    def _twist(self, number: int) -> Float[np.ndarray, "6"]:
        """Velocity of the camera in its own frame, from the poses before and after."""
        count = len(self._poses[self.plan.objects[0]])
        before, after = max(1, number - 1), min(count, number + 1)
        T_before_after = self._T_cam_world(before) @ invert_transform(self._T_cam_world(after))
        seconds = max(after - before, 1) / RATE_HZ
        turn = Rotation.from_matrix(T_before_after[:3, :3]).as_rotvec()
        return np.concatenate([T_before_after[:3, 3], turn]) / seconds

    def _truth(self, name: str, number: int, visibility: float) -> AnnotatedTruth:
        low, high = self._bounds[name]
        return AnnotatedTruth(
            name=name,
            category=name,
            T_cam_obj=self._poses[name][number - 1],
            extents=high - low,
            box_center=(low + high) / 2,
            visible_fraction=visibility,
            frame=f"{number:06d}",
            stamp=(number - 1) / RATE_HZ,
        )

    def _find_table(self) -> Float[np.ndarray, "4 4"]:
        """T_world_table of the plane on which most of the things stand; its y points up."""
        T_world_cam = invert_transform(self._T_cam_world(1))
        things = [
            transform_points(T_world_cam @ self._poses[name][0], self._meshes[name].vertices)
            for name in self.plan.objects
        ]
        return find_support(things, T_world_cam[:3, 3])


def _transforms(rows: Float[np.ndarray, "F 7"]) -> Float[np.ndarray, "F 4 4"]:
    T = np.tile(np.eye(4), (len(rows), 1, 1))
    T[:, :3, :3] = Rotation.from_quat(rows[:, [1, 2, 3, 0]]).as_matrix()
    T[:, :3, 3] = rows[:, 4:]
    return T


def _bounds(path: Path) -> Float[np.ndarray, "2 3"]:
    points = np.loadtxt(path)
    return np.stack([points.min(axis=0), points.max(axis=0)])


def _visibility(instance: MeshInstance, rendering: Rendering, camera: Camera) -> float:
    """Share of the silhouette inside the image that nothing hides."""
    alone = render_depth(Scene([instance]), camera)[1] == instance.instance_id
    seen = rendering.ids == instance.instance_id
    return float(seen.sum()) / max(int(alone.sum()), 1)


def _table_mesh(rng: np.random.Generator) -> TexturedMesh:
    half = 0.9
    corners = half * np.array([[-1.0, 0, -1], [-1, 0, 1], [1, 0, 1], [1, 0, -1]])
    uv = corners[:, [0, 2]] / rng.uniform(0.3, 1.2)
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    return TexturedMesh(corners, faces, uv, any_pattern(rng, 96, 96), Material(0.1, 20.0))


def _draw_lights(rng: np.random.Generator, R_world_table: np.ndarray) -> list[Light]:
    """Two lamps above the table."""
    lights = []
    for _ in range(2):
        direction = rng.normal(size=3)
        direction[1] = -abs(direction[1]) - 0.4
        level = float(rng.uniform(0.3, 0.6))
        direction = R_world_table @ direction / np.linalg.norm(direction)
        lights.append(Light(direction, (level, level, level)))
    return lights
