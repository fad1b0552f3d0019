"""Recordings made one after another, or several at the same time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeVar

Plan = TypeVar("Plan")


def make_all(
    make: Callable[[Plan], Path], plans: Sequence[Plan], processes: int, label: str
) -> None:
    """Make what is planned, with a bar of progress.

    Args:
        make: one; picklable where `processes` > 1.
        plans: of all.
        processes: how many at a time; 1 makes them here.
        label: of the bar.
    """
    from concurrent.futures import ProcessPoolExecutor
    from multiprocessing import get_context

    from tqdm import tqdm

    if processes == 1:
        for plan in tqdm(plans, desc=label):
            make(plan)
    else:
        with ProcessPoolExecutor(processes, get_context("spawn")) as pool:
            list(tqdm(pool.map(make, plans), total=len(plans), desc=label))
