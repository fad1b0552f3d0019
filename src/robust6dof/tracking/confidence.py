"""How far a pose can be trusted, from the evidence of its own frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from robust6dof.tracking.joint_pose import JointPose

FEATURES = ("support", "anchor_support", "residual", "disagreement", "foreground")
"""What the confidence is computed from, in this order."""


def evidence(estimate: JointPose) -> Float[np.ndarray, "5"]:
    """The features of one estimate, each about 0 to 1."""
    return np.array(
        [
            estimate.support,
            estimate.anchor_support,
            min(estimate.residual_share / 0.05, 2.0),
            min(estimate.disagreement / np.deg2rad(30.0), 2.0),
            estimate.foreground,
        ]
    )


@dataclass(frozen=True)
class ConfidenceModel:
    """Logistic model of the probability that the pose is within 10° and 5 cm."""

    weights: tuple[float, ...] = (3.0, 3.0, -1.0, -2.5, 2.0)
    """One for each of FEATURES."""
    bias: float = -2.0

    def __call__(self, estimate: JointPose) -> float:
        """The probability, 0 to 1."""
        score = float(np.dot(self.weights, evidence(estimate))) + self.bias
        return float(1.0 / (1.0 + np.exp(-score)))
