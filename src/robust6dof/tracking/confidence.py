"""How far a pose can be trusted, from the evidence of its own frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from robust6dof.geometry.transforms import axis_error, rotation_error
from robust6dof.solver.absolute import AbsoluteFit
from robust6dof.tracking.joint_pose import JointPose


@dataclass(frozen=True)
class ConfidenceModel:
    """Logistic model of the probability that a pose is within 10° and 5 cm."""

    weights: tuple[float, ...]
    """One for each part of the evidence."""
    bias: float

    def __call__(self, evidence: Float[np.ndarray, "F"]) -> float:
        """The probability, 0 to 1."""
        score = float(np.dot(self.weights, evidence)) + self.bias
        return float(1.0 / (1.0 + np.exp(-score)))


KEYPOINT_CONFIDENCE = ConfidenceModel((3.0, 3.0, -1.0, -2.5, 2.0), -2.0)
"""For `keypoint_evidence`; set by hand."""


def keypoint_evidence(estimate: JointPose) -> Float[np.ndarray, "5"]:
    """Support of past views and of the anchor, residual, disagreement, foreground: about 0 to 1."""
    return np.array(
        [
            estimate.support,
            estimate.anchor_support,
            min(estimate.residual_share / 0.05, 2.0),
            min(estimate.disagreement / np.deg2rad(30.0), 2.0),
            estimate.foreground,
        ]
    )


TRACK_CONFIDENCE = ConfidenceModel((4.0, 1.5, -2.0, -2.0, -1.0, 2.0), -2.0)
"""For `track_evidence`; set by hand."""


def track_evidence(
    surface: float,
    anchor: AbsoluteFit,
    T_cam_obj: Float[np.ndarray, "4 4"],
    scale: float,
    foreground: float,
    symmetric: bool,
) -> Float[np.ndarray, "6"]:
    """What speaks for and against a tracked pose, each part about 0 to 1.

    Args:
        surface: confidence of the registration.
        anchor: what this view alone says.
        T_cam_obj: the tracked pose.
        scale: its box diagonal [m].
        foreground: mean estimated share of points on the object.
        symmetric: compare the axes alone.

    Returns:
        surface, inlier share of the anchor, its disagreement in rotation, place and size, and the
        foreground.
    """
    error = axis_error if symmetric else rotation_error
    turn = float(error(T_cam_obj[:3, :3], anchor.T_cam_obj[:3, :3]))
    gap = float(np.linalg.norm(T_cam_obj[:3, 3] - anchor.T_cam_obj[:3, 3]))
    growth = abs(float(np.log(anchor.scale / scale)))
    return np.array(
        [
            surface,
            anchor.inlier_share,
            min(turn / np.deg2rad(30.0), 2.0),
            min(gap / (0.25 * scale), 2.0),
            min(growth / 0.3, 2.0),
            foreground,
        ]
    )
