"""What the network sees of the object, looked at from where the registration puts it."""

from __future__ import annotations

from dataclasses import dataclass

from robust6dof.frames import RgbdFrame, Track
from robust6dof.network.inputs import ViewFeatures
from robust6dof.solver.absolute import AbsoluteFit
from robust6dof.tracking.encoder import ViewEncoder, ViewRequest, encode_alone
from robust6dof.tracking.tracker_memory import TrackerMemory


@dataclass(frozen=True, eq=False)
class Sight:
    """The network's answer."""

    features: ViewFeatures
    anchor: AbsoluteFit
    """Its own absolute pose."""


@dataclass(frozen=True, eq=False)
class Look:
    """A registration and what the network sees from there."""

    surface: Track
    """The registration's track."""
    sight: Sight | None
    """None where there is no depth."""
    searched: bool = False
    """Registered from a pose that was proposed, not from where the object was followed to."""

    @classmethod
    def take(
        cls, encoder: ViewEncoder, frame: RgbdFrame, surface: Track, memory: TrackerMemory
    ) -> Look:
        """Look at `frame` from `surface`; `memory` holds the last view and the object's frame."""
        request = look_request(encoder, frame, surface, memory)
        return cls.answered(encoder, surface, memory, encode_alone(encoder.net, request))

    @classmethod
    def answered(
        cls,
        encoder: ViewEncoder,
        surface: Track,
        memory: TrackerMemory,
        features: ViewFeatures | None,
    ) -> Look:
        """With what the network said of the `look_request`."""
        if features is None:
            return cls(surface, None)
        return cls(surface, Sight(features, encoder.anchor(features, memory.frames)))


def look_request(
    encoder: ViewEncoder, frame: RgbdFrame, surface: Track, memory: TrackerMemory
) -> ViewRequest | None:
    """What to ask of the network; None where there is no depth."""
    T_cam_obj, extents = memory.T_cam_obj(surface), memory.extents
    return encoder.request(frame, T_cam_obj, extents, memory.last.features, memory.frames)
