"""Records for the protocol tests: a true pose and a prediction that is off by known amounts."""

import numpy as np
from scipy.spatial.transform import Rotation

from robust6dof.evaluation.records import PoseRecord
from robust6dof.geometry.transforms import make_transform

TRUE_POSE = make_transform(
    Rotation.from_euler("xyz", [200, 20, 10], degrees=True).as_matrix(), np.array([0.05, -0.1, 0.7])
)
EXTENTS = np.array([0.1, 0.12, 0.08])


def record(
    frame=1,
    *,
    turn_deg=0.0,
    axis="x",
    shift_cm=0.0,
    along="x",
    missing=False,
    category="camera",
    **fields,
):
    """A prediction turned about its own `axis` and shifted along a camera axis."""
    R_turn = Rotation.from_euler(axis, turn_deg, degrees=True).as_matrix()
    shift = shift_cm / 100 * np.eye(3)["xyz".index(along)]
    T_cam_obj = make_transform(TRUE_POSE[:3, :3] @ R_turn, TRUE_POSE[:3, 3] + shift)
    defaults = {
        "sequence": "s0",
        "object": "object_0",
        "category": category,
        "T_cam_obj_true": TRUE_POSE,
        "extents_true": EXTENTS,
        "T_cam_obj": None if missing else T_cam_obj,
        "extents": None if missing else EXTENTS,
    }
    return PoseRecord(frame=frame, **{**defaults, **fields})
