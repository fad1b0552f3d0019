"""How far a pose can be trusted, from the evidence of its own frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from robust6dof.solver.absolute import AbsoluteFit
from robust6dof.tracking.disagreement import Disagreement
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


TRACK_CONFIDENCE = ConfidenceModel((-0.54, -2.26, -0.53), -3.52)
"""For `look_evidence`; by `benchmarks/fit_confidence.py`."""

_LEAST_DEVIATION = 0.03
"""Two views never agree better by more than chance."""


def look_evidence(
    anchor: AbsoluteFit,
    T_cam_obj: Float[np.ndarray, "4 4"],
    scale: float,
    symmetric: bool,
) -> Float[np.ndarray, "3"]:
    """What one look of the network says against a tracked pose.

    Args:
        anchor: what this view alone says.
        T_cam_obj: the tracked pose.
        scale: its box diagonal [m].
        symmetric: compare the axes alone.

    Returns:
        Logarithms of how far the anchor is from it in rotation, place and size, each about 0 to 1.
    """
    apart = Disagreement.between(T_cam_obj, scale, anchor.T_cam_obj, anchor.scale, symmetric)
    deviations = [
        min(apart.rotation / np.deg2rad(30.0), 2.0),
        min(apart.translation / (0.25 * scale), 2.0),
        min(abs(apart.log_scale) / 0.3, 2.0),
    ]
    return np.log(np.array(deviations) + _LEAST_DEVIATION)
