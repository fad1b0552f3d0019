"""What a run is, and how each of its sequences went."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from robust6dof.baselines.registry import REMARKS
from robust6dof.evaluation.frame_choice import FrameChoice


@dataclass(frozen=True)
class RunInfo:
    """What `run.json` says."""

    tracker: str
    protocol: str
    data: str
    seed: int
    weights: str = ""
    """File of the network's weights; empty where there is none, or the shipped ones."""
    remark: str = ""
    """What must be said beside the figures."""
    meshes: str = ""
    """Folder with the meshes that were given to a tracker that is given one."""
    every: int = 1
    drop: int = 0
    most: int | None = None
    """See `FrameChoice`."""
    init_noise: float = 0.0
    """n of the paper's Init×n: further noise on the first pose."""
    all_noise: float = 0.0
    """n of its All×n: noise on every pose that the tracker steps from."""
    single_view: bool = False
    """Each frame by itself, from its mask alone: an estimate, not a track."""

    @staticmethod
    def of_named(
        tracker: str,
        protocol: str,
        data: Path,
        seed: int,
        weights: Path | None = None,
        meshes: Path | None = None,
        **choices: Any,
    ) -> RunInfo:
        """Of a tracker that `baselines.registry` knows, with its remark; `choices` are the other
        fields."""
        return RunInfo(
            tracker,
            protocol,
            str(data.resolve()),
            seed,
            weights=str(weights.resolve()) if weights else "",
            remark=REMARKS.get(tracker, ""),
            meshes=str(meshes.resolve()) if meshes else "",
            **choices,
        )

    @property
    def frames(self) -> FrameChoice:
        """Which frames were shown."""
        return FrameChoice(self.every, self.drop, self.most)


@dataclass(frozen=True)
class SequenceOutcome:
    """What `done.json` says."""

    frames: int
    seconds: float
    started: dict[str, str]
    """Object → name of its first frame."""
    failed: dict[str, str]
    """Object → why its tracker could not start; all its frames are missing."""
