"""Python functions on the threads that torch keeps for its own operations.

Between two operations torch's OpenMP threads spin for some milliseconds, so that the next one
starts at once. Threads of our own would have to share the cores with them; these need not.
"""

from __future__ import annotations

import ctypes
import functools
from collections.abc import Callable, Iterable, Sequence
from typing import Any, TypeVar

import torch

_Task = TypeVar("_Task")
_BODY = ctypes.CFUNCTYPE(None, ctypes.c_void_p)


def for_each(work: Callable[[_Task], None], tasks: Sequence[_Task]) -> None:
    """Call `work` on every task, in any order, as many at once as torch has threads.

    Worth it where `work` releases the interpreter's lock for most of a millisecond or more.
    Without GNU OpenMP (macOS, Windows) the tasks are done one after the other.
    """
    threads, run_team = min(torch.get_num_threads(), len(tasks)), _openmp_parallel()
    if threads < 2 or run_team is None:
        _drain(work, tasks)
        return
    left, errors = iter(tasks), []

    @_BODY
    def body(_: Any) -> None:
        try:
            _drain(work, left)  # shared: each thread takes the next task
        except BaseException as error:
            errors.append(error)

    run_team(body, None, threads, 0)
    if errors:
        raise errors[0]


def _drain(work: Callable[[_Task], None], tasks: Iterable[_Task]) -> None:
    for task in tasks:
        work(task)


@functools.cache
def _openmp_parallel() -> Any | None:
    """What compilers turn `#pragma omp parallel` into: (body, data, threads, flags)."""
    try:
        return ctypes.CDLL(None).GOMP_parallel
    except (AttributeError, OSError, TypeError):
        return None
