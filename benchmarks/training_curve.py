"""Draw a training run: its loss, and how good it was on held-out shapes.

python benchmarks/training_curve.py RUN/log.jsonl --out curve.png
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import matplotlib.pyplot as plt
import numpy as np
import tyro


@dataclass(frozen=True)
class Options:
    log: Annotated[Path, tyro.conf.Positional]
    """log.jsonl of a training run."""
    out: Path = Path("training_curve.png")
    """Picture to write."""


def main(options: Options) -> None:
    rows = [json.loads(line) for line in options.log.read_text().splitlines()]
    losses = np.array([(row["step"], row["loss"]) for row in rows if "loss" in row])
    scores = [row for row in rows if "validation/anchor_deg" in row]
    steps = [row["step"] for row in scores]
    figure, (left, middle, right) = plt.subplots(1, 3, figsize=(11, 3), layout="constrained")
    width = max(1, len(losses) // 100)
    smooth = np.convolve(losses[:, 1], np.ones(width) / width, "valid")
    left.plot(losses[width - 1 :, 0], smooth)
    left.set(xlabel="step", ylabel="loss (running mean)")
    for name, label in (("anchor", "one view alone"), ("step", "change between views")):
        middle.plot(steps, [row[f"validation/{name}_5deg5cm"] for row in scores], label=label)
        right.plot(steps, [row[f"validation/{name}_deg"] for row in scores], label=label)
    given = scores[-1]["validation/start_5deg5cm"]
    middle.axhline(given, color="grey", linestyle=":", label="the prediction given")
    middle.set(xlabel="step", ylabel="held-out pairs within 5°, 5 cm [%]", ylim=(0, 100))
    right.axhline(scores[-1]["validation/start_deg"], color="grey", linestyle=":")
    right.set(xlabel="step", ylabel="median rotation error [°]", ylim=(0, None))
    middle.legend(fontsize="small")
    figure.savefig(options.out, dpi=110)


if __name__ == "__main__":
    main(tyro.cli(Options, description=__doc__))
