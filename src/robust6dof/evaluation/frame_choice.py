"""Part of a data set's frames: for quick looks, and for the paper's dropped frames."""

from __future__ import annotations

from dataclasses import dataclass, replace

from robust6dof.data.dataset import Dataset, DatasetSequence, ObjectTruth
from robust6dof.errors import InputError
from robust6dof.frames import RgbdFrame


@dataclass(frozen=True)
class FrameChoice:
    """Which frames of each sequence a tracker is shown, and is scored on.

    Raises:
        InputError: numbers that leave nothing.
    """

    every: int = 1
    """Each n-th frame."""
    drop: int = 0
    """So many of these are left out between the first and the second."""
    most: int | None = None
    """At most so many in the end."""

    def __post_init__(self) -> None:
        if self.every < 1 or self.drop < 0 or (self.most is not None and self.most < 1):
            raise InputError("every and most count from 1, drop from 0")

    def __str__(self) -> str:
        parts = [f"each {self.every}th"] * (self.every > 1)
        parts += [f"{self.drop} dropped after the first"] * (self.drop > 0)
        parts += [f"at most {self.most} of a sequence"] * (self.most is not None)
        return ", ".join(parts) or "all"

    def indices(self, count: int) -> list[int]:
        """Of the frames chosen out of `count`."""
        chosen = list(range(0, count, self.every))
        return (chosen[:1] + chosen[1 + self.drop :])[: self.most]

    def of(self, dataset: Dataset) -> Dataset:
        """The data set with the chosen frames alone."""
        if self == FrameChoice():
            return dataset
        sequences = tuple(
            ChosenFrames(s, s.name, tuple(self.indices(len(s)))) for s in dataset.sequences
        )
        return replace(dataset, sequences=sequences)


class ChosenFrames(DatasetSequence):
    """Some frames of a sequence."""

    def __init__(self, whole: DatasetSequence, name: str, indices: tuple[int, ...]) -> None:
        self.whole = whole
        self.name = name
        self.indices = indices
        self.frame_names = tuple(whole.frame_names[i] for i in indices)

    def frame(self, index: int) -> RgbdFrame:
        return self.whole.frame(self.indices[index])

    def truth(self, index: int) -> tuple[ObjectTruth, ...]:
        return self.whole.truth(self.indices[index])

    def missing(self, index: int) -> tuple[str, ...]:
        return self.whole.missing(self.indices[index])
