"""Trackers by name, for the command line, the evaluation and the guidance."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from robust6dof.errors import InputError
from robust6dof.frames import PoseTracker
from robust6dof.shapes.mesh import TexturedMesh

if TYPE_CHECKING:
    from robust6dof.tracking.encoder import ViewEncoder

MeshSource = Callable[[], TexturedMesh]
"""Gives the CAD mesh of the object to be followed, centred on its box; asked only by trackers that
are given one."""


@dataclass(frozen=True)
class Ingredients:
    """What trackers are made from."""

    category: str
    seed: int
    weights: Path | None
    device: str
    cad: MeshSource | None
    exact_start: bool


def make_tracker(
    name: str,
    category: str,
    *,
    seed: int = 0,
    weights: Path | None = None,
    device: str = "auto",
    cad: MeshSource | None = None,
    exact_start: bool = False,
) -> PoseTracker:
    """A tracker by name.

    Args:
        name: one of TRACKERS.
        category: of the object; decides the prior that it starts from.
        seed: of everything random in it.
        weights: of the network's trackers; the shipped ones if not given.
        device: of the network: auto, cpu or cuda.
        cad: gives the object's mesh to `oracle-icp`.
        exact_start: the start pose will be true; the other trackers never doubt theirs.

    Raises:
        InputError: an unknown name, or what the tracker needs is not given.
        DataError: unusable weights.
    """
    if name not in TRACKERS:
        raise InputError(f"no tracker '{name}'; there is: {', '.join(TRACKERS)}")
    return TRACKERS[name](Ingredients(category, seed, weights, device, cad, exact_start))


def _icp(given: Ingredients) -> PoseTracker:
    from robust6dof.tracking.surface.icp import IcpTracker

    return IcpTracker(given.category, seed=given.seed)


def _static(given: Ingredients) -> PoseTracker:
    from robust6dof.baselines.static import StaticTracker

    return StaticTracker(given.category)


def _features(given: Ingredients) -> PoseTracker:
    from robust6dof.baselines.features import FeatureTracker

    return FeatureTracker(given.category, seed=given.seed)


def _oracle_icp(given: Ingredients) -> PoseTracker:
    from robust6dof.baselines.oracle_icp import OracleIcpTracker

    if given.cad is None:
        raise InputError(
            "oracle-icp is given the object's CAD mesh, so it runs where meshes are known: in "
            "predict, on synthetic data or with --meshes"
        )
    return OracleIcpTracker(given.cad(), given.category, seed=given.seed)


def _network(given: Ingredients, recover: bool = True) -> PoseTracker:
    from robust6dof.tracking.canonical_frame import EXACT_START, ROUGH_START
    from robust6dof.tracking.tracker import Tracker
    from robust6dof.tracking.tracker_config import TrackerConfig

    doubt = EXACT_START if given.exact_start else ROUGH_START
    return Tracker(_encoder(given), TrackerConfig(given_doubt=doubt, recover=recover))


def _encoder(given: Ingredients) -> ViewEncoder:
    from robust6dof.tracking.encoder import ViewEncoder

    return ViewEncoder.from_pretrained(given.weights, given.category, given.device, given.seed)


def _keypoints(given: Ingredients) -> PoseTracker:
    """The paper's tracker: keypoint matches, without surface registration."""
    from robust6dof.tracking.keypoint_tracker import KeypointTracker

    return KeypointTracker(_encoder(given))


def _chained(given: Ingredients) -> PoseTracker:
    """Pose changes from the last frame alone, multiplied up: what drifts."""
    from robust6dof.tracking.joint_pose import JointPoseConfig
    from robust6dof.tracking.keypoint_tracker import KeypointConfig, KeypointTracker

    config = KeypointConfig(JointPoseConfig(anchor_weight=0.0), scale_gain=0.0, memory_capacity=0)
    return KeypointTracker(_encoder(given), config)


def _unsupervised_keypoints(given: Ingredients) -> PoseTracker:
    """6-PACK's manner: keypoints from one pooled feature, matched by index with the last frame
    alone, pose changes chained."""
    from robust6dof.tracking.joint_pose import JointPoseConfig
    from robust6dof.tracking.keypoint_tracker import KeypointConfig, KeypointTracker

    if given.weights is None:
        raise InputError(
            "unsupervised-keypoints needs weights of its own: train them with robust6dof "
            "experiment keypoint-ablation, and give the file with --weights"
        )
    config = KeypointConfig(pose=JointPoseConfig(anchor_weight=0.0), memory_capacity=0)
    tracker = KeypointTracker(_encoder(given), config)
    source = tracker.net.config.keypoint_source
    if source != "unsupervised":
        raise InputError(f"{given.weights} has keypoints of the kind '{source}', not unsupervised")
    return tracker


TRACKERS: dict[str, Callable[[Ingredients], PoseTracker]] = {
    "robust6dof": _network,
    "no-recovery": partial(_network, recover=False),
    "keypoints": _keypoints,
    "chained": _chained,
    "icp": _icp,
    "features": _features,
    "oracle-icp": _oracle_icp,
    "unsupervised-keypoints": _unsupervised_keypoints,
    "static": _static,
}

REMARKS = {
    "no-recovery": "no-recovery is robust6dof that does not look for what it has lost",
    "chained": "chained matches with the last frame alone: pose changes, nothing absolute",
    "oracle-icp": "oracle-icp is given the CAD mesh of the very object, which no other tracker has",
    "unsupervised-keypoints": "unsupervised-keypoints is the network in 6-PACK's manner, with "
    "weights of its own",
}
"""What must be said beside a tracker's figures."""
