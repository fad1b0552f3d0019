"""Many seeds in parallel; a finished seed is kept while its settings stay the same."""

from __future__ import annotations

import json
import multiprocessing
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path
from typing import Any

from robust6dof.errors import InputError
from robust6dof.simulation.outcome import Outcome

_SUMMARY, _SETTINGS = "summary.json", "settings.json"


def parse_seeds(text: str) -> tuple[int, ...]:
    """`7`, `0..19` (both ends included), or several of these with commas.

    Raises:
        InputError: anything else, or a seed below 0.
    """
    seeds: list[int] = []
    for part in text.split(","):
        first, dots, last = part.strip().partition("..")
        try:
            low = int(first)
            high = int(last) if dots else low
        except ValueError:
            raise InputError(f"seeds read 7, 0..19 or 1,4,9; got '{text}'") from None
        if low < 0 or high < low:
            raise InputError(f"seeds must be 0 or more and rise, got '{part.strip()}'")
        seeds += range(low, high + 1)
    return tuple(dict.fromkeys(seeds))


def seed_folder(out: Path, seed: int) -> Path:
    """Where a seed's files are."""
    return out / f"seed_{seed:04d}"


def finished(folder: Path, settings: Mapping[str, Any]) -> Outcome | None:
    """The outcome stored in a seed's folder, if it is complete and of the same settings."""
    try:
        stored = json.loads((folder / _SETTINGS).read_text())
        summary = json.loads((folder / _SUMMARY).read_text())
        same = stored == json.loads(json.dumps(settings))
        summary["limits_broken"] = tuple(summary.get("limits_broken", ()))
        return Outcome(**summary) if same else None
    except (OSError, ValueError, TypeError):
        return None


def store(folder: Path, outcome: Outcome, settings: Mapping[str, Any]) -> None:
    """Mark a seed as finished; the last thing to be written."""
    (folder / _SETTINGS).write_text(json.dumps(settings, indent=1) + "\n")
    (folder / _SUMMARY).write_text(json.dumps(outcome.as_dict(), indent=1) + "\n")


def run_all(
    fly: Callable[[int], Outcome], seeds: Sequence[int], processes: int
) -> Iterator[Outcome]:
    """Outcomes in the order in which the runs end.

    Args:
        fly: runs one seed and stores its files; picklable if `processes` > 1.
        seeds: which.
        processes: how many at a time; 1 runs here.
    """
    if processes <= 1 or len(seeds) <= 1:
        yield from map(fly, seeds)
        return
    # One thread for each process: the linear algebra here is too small to share.
    for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "NUMBA_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(min(processes, len(seeds)), mp_context=context) as pool:
        futures = [pool.submit(fly, seed) for seed in seeds]
        try:
            for future in as_completed(futures):
                yield future.result()
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
