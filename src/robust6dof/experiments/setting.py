"""What every experiment is given, and the two loops that all of them share."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from robust6dof.baselines.registry import make_tracker
from robust6dof.data.dataset import Dataset
from robust6dof.data.truth_file import open_with_truth
from robust6dof.evaluation.evaluate import Stored, read_stored, score_stored
from robust6dof.evaluation.predict import predict
from robust6dof.evaluation.protocols import find_protocol
from robust6dof.evaluation.run_info import RunInfo
from robust6dof.evaluation.scores import Scores
from robust6dof.synthetic.aerial import is_done, synthesize
from robust6dof.synthetic.plans import plan_aerial, plan_split

_NEXT_RUN = 1_000_000
"""Added to the frames of each further run that is pooled: other images of the same sequence."""


@dataclass(frozen=True)
class Size:
    """How much is done."""

    sequences: int | None
    """Of the data set; made where none is given."""
    frames: int | None
    """Of each sequence, at most."""
    view_every: int
    """Single views are estimated on each n-th frame."""
    preset: str
    """Network of the ablations."""
    steps: int
    """Training steps of each of their rows."""


SIZES = {
    "tiny": Size(2, 12, 6, "tiny", 2),
    "small": Size(6, 60, 15, "small", 300),
    "full": Size(None, None, 5, "paper", 20_000),
}
"""`tiny`: does it run? `small`: minutes to an hour on two cores. `full`: all of the data, or the
`full` split of AerialPose-Sim."""


@dataclass(frozen=True)
class Setting:
    """One call of an experiment."""

    out: Path
    """Its own folder; what it shares with others lies beside."""
    data: Path | None
    """A data set with ground truth; a synthetic one is made where none is given."""
    tracker: str
    baselines: tuple[str, ...]
    """Trackers to stand beside."""
    size: Size
    weights: Path | None = None
    device: str = "auto"
    seed: int = 0
    processes: int = 1
    network: str | None = None
    """Preset of the ablations' network, instead of the size's."""
    steps: int | None = None
    """Training steps of each of their rows, instead of the size's."""
    trainings: int = 1
    """How often each row is trained, with seeds from `seed` on."""
    models: Path | None = None
    """Model points for ADD and ADD-S."""
    meshes: Path | None = None
    """Meshes for ADD and ADD-S where there are no points, and for `oracle-icp`; see
    `find_cad_mesh`."""

    @property
    def trackers(self) -> tuple[str, ...]:
        """The one in question first."""
        others = (name for name in self.baselines if name != self.tracker)
        return (self.tracker, *others)

    @property
    def preset(self) -> str:
        """Of the ablations' network."""
        return self.network or self.size.preset

    @property
    def training_steps(self) -> int:
        """Of each row of an ablation."""
        return self.steps or self.size.steps

    def dataset_path(self) -> Path:
        """The data; made beside the experiment's folder where none is given."""
        if self.data is not None:
            return self.data
        count, frames = self.size.sequences, self.size.frames
        if count is None or frames is None:
            out, plans = self.out.parent / "aerial-full", plan_split("full")
        else:
            out = self.out.parent / f"aerial-{count}x{frames}-seed{self.seed}"
            plans = plan_aerial(self.seed, count, frames, ("agile",))
        for plan in plans:
            if not is_done(plan, out / plan.name):
                print(f"data: {synthesize(plan, out)}", flush=True)
        return out

    def dataset(self) -> Dataset:
        """The sequences that are used."""
        dataset = open_with_truth(self.dataset_path())
        return replace(dataset, sequences=dataset.sequences[: self.size.sequences])

    def predict(self, tracker: str, protocol: str, label: str = "", **choices: Any) -> Path:
        """Run a tracker, or take up its run; returns the run's folder, which experiments share.

        Args:
            tracker: its name.
            protocol: of the start.
            label: tells runs of one tracker apart.
            choices: fields of `RunInfo`: drop, every, init_noise, …; and `weights`.
        """
        weights = choices.pop("weights", self.weights)
        given: dict[str, Any] = {"most": self.size.frames} | choices
        info = RunInfo.of_named(
            tracker, protocol, self.dataset_path(), self.seed, weights, self.meshes, **given
        )
        name = "-".join(part for part in (tracker, protocol, label) if part)
        out = self.out.parent / "runs" / self.dataset_path().name / name
        make = partial(make_tracker, tracker, seed=self.seed, weights=weights, device=self.device)
        names = [sequence.name for sequence in self.dataset().sequences]
        for name in predict(make, info, out, names, self.processes):
            print(f"{out.name}: {name}", flush=True)
        return out

    def stored(self, run: Path, protocol: str) -> Stored:
        """A run's records of the sequences that are used."""
        used = [sequence.name for sequence in self.dataset().sequences]
        (stored,) = read_stored(run, find_protocol(protocol), sequences=used)
        return stored

    def scores(self, run: Path, protocol: str) -> Scores:
        """A run's scores, with their interval."""
        return self.pooled_scores([run], protocol)

    def pooled_scores(self, runs: Sequence[Path], protocol: str) -> Scores:
        """Scores over the frames of several runs; the interval draws a sequence of all together."""
        stored = [self.stored(run, protocol) for run in runs]
        records = [
            replace(record, frame=record.frame + number * _NEXT_RUN)
            for number, one in enumerate(stored)
            for record in one.records
        ]
        pooled = replace(stored[0], records=records)
        return score_stored(pooled, find_protocol(protocol), self.models)
