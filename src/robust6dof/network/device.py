"""Where the network runs."""

from __future__ import annotations

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
