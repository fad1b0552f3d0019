"""Where the network runs, and what it asks of that place."""

from __future__ import annotations

import ctypes

import torch

from robust6dof.errors import InputError


def resolve_device(choice: str) -> str:
    """`auto` as cuda where there is one, else cpu; other choices as they are.

    Raises:
        InputError: cuda asked for where torch finds none.
    """
    if choice == "auto":
        return "cuda" if torch.cuda.is_available() else "cpu"
    if choice.startswith("cuda") and not torch.cuda.is_available():
        raise InputError(
            "no CUDA device: torch finds none here; use --device cpu, or install a CUDA build of "
            "torch"
        )
    return choice


_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3  # glibc's malloc.h


def keep_freed_memory() -> None:
    """Let glibc keep what one step frees for the next one.

    It would hand pieces of some megabytes back to the system at once, and each fresh page of the
    next step costs microseconds. The limits are those that it sets itself after a piece of 32 MB
    was freed: at most 64 MB are kept. Other C libraries are left as they are.
    """
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (AttributeError, OSError, TypeError):
        return
    mallopt(_M_MMAP_THRESHOLD, 32 * 2**20)
    mallopt(_M_TRIM_THRESHOLD, 64 * 2**20)
