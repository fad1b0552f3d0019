"""The progress of a training run: on screen, in `log.jsonl`, and in TensorBoard where installed."""

from __future__ import annotations

import json
import os
import time
from pathlib import Path

from tqdm import tqdm


class TrainLog:
    """Rows of losses and of validation scores by step.

    A run that was killed has logged steps after its last checkpoint, and maybe half a line; they
    are removed, since those steps are taken again.

    Args:
        out: folder of the run.
        first: steps done so far.
        steps: of the whole run.
        quiet: write nothing (processes other than the first).
    """

    def __init__(self, out: Path, first: int, steps: int, quiet: bool) -> None:
        self._path = out / "log.jsonl"
        self._bar = tqdm(total=steps, initial=first, disable=quiet, unit="step", mininterval=5)
        earlier = 0.0 if quiet else _keep_until(self._path, first)
        self._start = time.monotonic() - earlier
        self._board = None if quiet else _tensorboard(out, first)

    def losses(self, step: int, parts: dict[str, float], every: int) -> None:
        """The losses of a step, of which each `every`-th is kept."""
        self._bar.update(1)
        if step % every == 0:
            self._bar.set_postfix(loss=f"{parts['loss']:.3f}")
            self._write(step, parts)

    def scores(self, step: int, scores: dict[str, float]) -> None:
        """What `validate` said after a step."""
        self._bar.write(
            f"step {step}: 5°5cm {scores['anchor_5deg5cm']:.1f} % from one view "
            f"({scores['anchor_deg']:.1f}°, {scores['anchor_cm']:.1f} cm), "
            f"step {scores['step_5deg5cm']:.1f} % ({scores['step_deg']:.1f}°), "
            f"given {scores['start_5deg5cm']:.1f} %"
        )
        self._write(step, {f"validation/{name}": value for name, value in scores.items()})

    def close(self) -> None:
        """Finish the bar and TensorBoard's file."""
        self._bar.close()
        if self._board is not None:
            self._board.close()

    def _write(self, step: int, values: dict[str, float]) -> None:
        with self._path.open("a") as file:
            seconds = round(time.monotonic() - self._start, 1)
            file.write(json.dumps({"step": step, "seconds": seconds} | values) + "\n")
        if self._board is not None:
            for name, value in values.items():
                self._board.add_scalar(name, value, step)


def _keep_until(path: Path, step: int) -> float:
    """Remove rows after a step and a torn last line; returns the seconds of training so far."""
    if not path.exists():
        return 0.0
    lines = path.read_text().splitlines(keepends=True)
    rows = [(line, json.loads(line)) for line in lines if line.endswith("\n")]
    kept = [(line, row) for line, row in rows if row["step"] <= step]
    shorter = path.with_suffix(".new")
    shorter.write_text("".join(line for line, _ in kept))
    os.replace(shorter, path)
    return float(kept[-1][1]["seconds"]) if kept else 0.0


def _tensorboard(out: Path, first: int):
    try:
        from torch.utils.tensorboard import SummaryWriter
    except ImportError:
        return None
    return SummaryWriter(str(out / "tensorboard"), purge_step=first + 1 if first else None)
