"""Stored YCB-Video poses in the pack of ICG (DLR-RM/3DObjectTracking, poses_ycb-video.zip).

`poses/<method>/<video>_<object>.txt` holds one line a keyframe, `qw qx qy qz tx ty tz` (metres,
object to camera), of which most methods' quaternions are not of unit length. The files of
`poses/ground_truth` are the truth.
"""

from __future__ import annotations

import zipfile
from pathlib import Path, PurePosixPath

import numpy as np
from scipy.spatial.transform import Rotation

from robust6dof.errors import DataError
from robust6dof.evaluation.records import PoseRecord

GROUND_TRUTH = "ground_truth"


def icg_methods(path: str | Path) -> list[str]:
    """Names of the methods whose poses the pack holds."""
    return sorted(set(_files(Path(path))) - {GROUND_TRUTH})


def read_icg_poses(path: str | Path, method: str) -> list[PoseRecord]:
    """One record per keyframe and object of the truth, with the method's pose.

    Raises:
        DataError: not such a pack, no such method, or files that do not fit the truth's.
    """
    path = Path(path)
    files = _files(path)
    if method not in files or GROUND_TRUTH not in files:
        known = ", ".join(name for name in sorted(files) if name != GROUND_TRUTH)
        raise DataError(path, f"it has no method '{method}'", f"There is: {known or 'nothing'}")
    records: list[PoseRecord] = []
    with zipfile.ZipFile(path) as pack:
        for name, member in sorted(files[GROUND_TRUTH].items()):
            truth = _poses(path, member, pack.read(member))
            records += _records(path, name, truth, _predicted(path, pack, files[method], name))
    return records


def _files(path: Path) -> dict[str, dict[str, str]]:
    """Method → file stem → member of the zip."""
    if not zipfile.is_zipfile(path):
        raise DataError(path, "not a zip file", "Give ICG's poses_ycb-video.zip")
    files: dict[str, dict[str, str]] = {}
    with zipfile.ZipFile(path) as pack:
        for member in pack.namelist():
            parts = PurePosixPath(member)
            if parts.suffix == ".txt" and len(parts.parts) >= 2:
                files.setdefault(parts.parts[-2], {})[parts.stem] = member
    return files


def _predicted(
    path: Path, pack: zipfile.ZipFile, files: dict[str, str], name: str
) -> np.ndarray | None:
    """The method's poses of one file; None where it has none, so that all are missing."""
    return _poses(path, files[name], pack.read(files[name])) if name in files else None


def _poses(path: Path, member: str, content: bytes) -> np.ndarray:
    try:
        rows = np.array([line.split() for line in content.decode().splitlines()], float)
        if rows.ndim != 2 or rows.shape[1] != 7:
            raise ValueError("a line must be qw qx qy qz tx ty tz")
        poses = np.tile(np.eye(4), (len(rows), 1, 1))
        # A quaternion of zeros is how a pose that was not found is written.
        found = np.linalg.norm(rows[:, :4], axis=1) > 1e-6
        quat_xyzw = rows[found][:, [1, 2, 3, 0]]
        poses[found, :3, :3] = Rotation.from_quat(quat_xyzw).as_matrix()
    except ValueError as error:
        raise DataError(path, f"{member} is unreadable ({error})", "Get the pack again") from error
    poses[:, :3, 3] = rows[:, 4:]
    poses[~found] = np.nan
    return poses


def _records(
    path: Path, name: str, truth: np.ndarray, predicted: np.ndarray | None
) -> list[PoseRecord]:
    if predicted is not None and len(predicted) != len(truth):
        raise DataError(
            path, f"{name} has {len(predicted)} poses but {len(truth)} truths", "Get the pack again"
        )
    video, object_name = name.split("_", 1)
    return [
        PoseRecord(
            sequence=video,
            frame=i,
            object=object_name,
            category=object_name,
            T_cam_obj_true=truth[i],
            extents_true=np.full(3, np.nan),
            T_cam_obj=None
            if predicted is None or not np.isfinite(predicted[i]).all()
            else predicted[i],
        )
        for i in range(len(truth))
    ]
