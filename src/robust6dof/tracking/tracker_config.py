"""How the tracker uses network and registration."""

from __future__ import annotations

from dataclasses import dataclass, field

from robust6dof.tracking.canonical_frame import (
    ESTIMATED_START,
    ROUGH_START,
    CanonicalFrameConfig,
    Doubt,
)
from robust6dof.tracking.confidence import TRACK_CONFIDENCE, ConfidenceModel
from robust6dof.tracking.first_look import FirstLookConfig
from robust6dof.tracking.joint_pose import JointPoseConfig
from robust6dof.tracking.place import PlaceConfig
from robust6dof.tracking.recovery import RecoveryConfig
from robust6dof.tracking.states import StateRules
from robust6dof.tracking.surface.icp_config import IcpConfig


@dataclass(frozen=True)
class TrackerConfig:
    """How network and registration work together."""

    surface: IcpConfig = field(default_factory=IcpConfig)
    canonical: CanonicalFrameConfig = field(default_factory=CanonicalFrameConfig)
    pose: JointPoseConfig = field(default_factory=JointPoseConfig)
    """Of the poses that the network alone proposes."""
    confidence: ConfidenceModel = TRACK_CONFIDENCE
    surface_share: float = 2.0
    """The confidence is at most so many times that of the registration: a network that says what it
    was told is no witness."""
    states: StateRules = field(default_factory=StateRules)
    given_doubt: Doubt = ROUGH_START
    """In a start pose that was given; `EXACT_START` where it is known to be true."""
    estimated_doubt: Doubt = ESTIMATED_START
    """In one that was estimated from a mask, a box or nothing."""
    first_look: FirstLookConfig = field(default_factory=FirstLookConfig)
    look_every: int = 2
    """Frames from one look of the network to the next while all goes well; registration learns on
    the others, so that no frame pays for both."""
    surface_trust: float = 0.5
    """Confidence of the registration from which a look is believed to be placed rightly."""
    anchor_trust: float = 0.35
    """Least share of points that must agree with a look's own pose."""
    recover: bool = True
    """Look for a lost object in the whole image, and believe only what is confirmed."""
    recovery: RecoveryConfig = field(default_factory=RecoveryConfig)
    place: PlaceConfig = field(default_factory=PlaceConfig)
    jump_s: float = 0.25
    """After a longer gap between two frames the object is taken for lost."""
    memory_capacity: int = 12
    """Views kept to be matched."""
