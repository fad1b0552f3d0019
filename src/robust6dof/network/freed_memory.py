"""What the network asks of the C library; imports nothing heavy."""

from __future__ import annotations

import ctypes

_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3  # glibc's malloc.h


def keep_freed_memory() -> None:
    """Let glibc keep what one step frees for the next one.

    It would hand pieces of some megabytes back to the system at once, and each fresh page of the
    next step costs microseconds. The limits are those that it sets itself after a piece of 32 MB
    was freed: at most 64 MB are kept. It holds for the whole process, so the commands ask for it,
    and a program of one's own may. Other C libraries are left as they are.
    """
    try:
        mallopt = ctypes.CDLL(None).mallopt
    except (AttributeError, OSError, TypeError):
        return
    mallopt(_M_MMAP_THRESHOLD, 32 * 2**20)
    mallopt(_M_TRIM_THRESHOLD, 64 * 2**20)
