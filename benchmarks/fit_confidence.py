"""Fit the tracker's confidence to recordings with truth; prints the constants and their error.

    robust6dof synthesize aerial --seed 301 --sequences 36 --frames 90 \\
        --difficulty leaving harsh --out fit
    python benchmarks/fit_confidence.py fit [--starts 0 12]

Each recording is tracked from each start's disturbed pose; starts from 10 on lose 3 to 20 frames
now and then. The cross-validated error leaves out whole recordings.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import minimize

from robust6dof.data import read_video
from robust6dof.data.truth_file import FILE_NAME, read_truth_file
from robust6dof.evaluation.calibration import reliability
from robust6dof.evaluation.start_noise import perturb
from robust6dof.tracking.disagreement import Disagreement
from robust6dof.tracking.tracker import Tracker

FIRST_WITH_GAPS = 10
_RIDGE = 10.0
_FOLDS = 5


@dataclass(frozen=True, eq=False)
class Sample:
    """One recording from one start: evidence of the frames that were looked at, and their truth."""

    recording: int
    evidence: Float[np.ndarray, "F E"]
    right: Bool[np.ndarray, "F"]
    unseen: int
    """Frames with nothing to look at: their confidence is 0, and …"""
    unseen_right: int
    """… so many of them held the right pose all the same."""


def arrivals(count: int, start: int, rng: np.random.Generator) -> Iterator[int]:
    """Indices of the frames that reach the tracker."""
    index = 1
    while index < count:
        if start >= FIRST_WITH_GAPS and rng.random() < 0.04:
            index += int(rng.integers(3, 20))
            continue
        yield index
        index += 1


def follow(number: int, folder: Path, start: int) -> Sample:
    """Track one recording."""
    truths, frames = read_truth_file(folder / FILE_NAME), list(read_video(folder))
    rng = np.random.default_rng([start, sum(map(ord, folder.name))])
    first = truths[0]
    T_start, extents = perturb(first.T_cam_obj, first.extents, rng)
    tracker = Tracker.from_pretrained(category=first.category, seed=start)
    track = tracker.start(frames[0], T_cam_obj=T_start, extents=extents)
    evidence, right, unseen = [], [], []
    for index in arrivals(len(frames), start, rng):
        track, truth = tracker.step(track, frames[index]), truths[index]
        apart = Disagreement.between(track.T_cam_obj, 1.0, truth.T_cam_obj, 1.0, truth.symmetric)
        fits = apart.rotation <= np.deg2rad(10.0) and apart.translation <= 0.05
        if track.memory.evidence is None:
            unseen.append(fits)
        else:
            evidence.append(track.memory.evidence)
            right.append(fits)
    return Sample(number, np.array(evidence), np.array(right, bool), len(unseen), sum(unseen))


def fit(evidence: np.ndarray, right: np.ndarray) -> tuple[np.ndarray, float]:
    """Weights and bias of the logistic model, with a ridge on the standardised weights."""
    mean, spread = evidence.mean(axis=0), evidence.std(axis=0) + 1e-9
    Z = np.column_stack([(evidence - mean) / spread, np.ones(len(evidence))])

    def loss(w: np.ndarray) -> tuple[float, np.ndarray]:
        score = Z @ w
        cost = np.logaddexp(0.0, -(2.0 * right - 1.0) * score).sum() + _RIDGE * (w[:-1] ** 2).sum()
        slope = Z.T @ (1.0 / (1.0 + np.exp(-score)) - right)
        return float(cost), slope + 2.0 * _RIDGE * np.append(w[:-1], 0.0)

    w = minimize(loss, np.zeros(Z.shape[1]), jac=True, method="L-BFGS-B").x
    weights = w[:-1] / spread
    return weights, float(w[-1] - weights @ mean)


def cross_validated(samples: list[Sample]) -> tuple[np.ndarray, np.ndarray]:
    """Confidence of every frame from a fit without its recording, and whether it is right."""
    confidence, right = [], []
    for fold in range(_FOLDS):
        kept = [s for s in samples if s.recording % _FOLDS != fold]
        weights, bias = fit(*_joined(kept))
        for sample in [s for s in samples if s.recording % _FOLDS == fold]:
            score = sample.evidence.reshape(-1, len(weights)) @ weights + bias
            confidence += [1.0 / (1.0 + np.exp(-score)), np.zeros(sample.unseen)]
            held = np.arange(sample.unseen) < sample.unseen_right
            right += [sample.right, held]
    return np.concatenate(confidence), np.concatenate(right)


def _joined(samples: list[Sample]) -> tuple[np.ndarray, np.ndarray]:
    seen = [sample for sample in samples if len(sample.right)]
    return np.concatenate([s.evidence for s in seen]), np.concatenate([s.right for s in seen])


def main() -> None:
    parser = argparse.ArgumentParser(description="Fit the confidence")
    parser.add_argument("data", type=Path, nargs="+")
    parser.add_argument("--starts", type=int, nargs="+", default=[0, 12])
    options = parser.parse_args()
    folders = sorted(
        folder
        for data in options.data
        for folder in data.iterdir()
        if (folder / FILE_NAME).is_file()
    )
    samples = []
    for number, folder in enumerate(folders):
        for start in options.starts:
            samples.append(follow(number, folder, start))
            print(f"{folder.name} from start {start}: {len(samples[-1].right)} frames", flush=True)
    confidence, right = cross_validated(samples)
    weights, bias = fit(*_joined(samples))
    print(f"weights {np.round(weights, 2).tolist()}, bias {bias:.2f}")
    print(f"{len(right)} frames, {100 * right.mean():.0f} % right")
    print(f"calibration error, left out: {reliability(confidence, right).expected_error:.3f}")


if __name__ == "__main__":
    main()
