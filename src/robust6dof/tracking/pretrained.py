"""The weights in the box, or one's own."""

from __future__ import annotations

from importlib.resources import as_file, files
from pathlib import Path

from robust6dof.errors import DataError
from robust6dof.network.checkpoint import load_network
from robust6dof.network.device import resolve_device
from robust6dof.network.robust6dof_net import Robust6DofNet

SHIPPED = "categories"
"""Name of the shipped weights of the six categories."""


def load_pretrained(path: str | Path | None = None, device: str = "auto") -> Robust6DofNet:
    """A trained network, in evaluation mode; nothing is fetched.

    Args:
        path: weights (.safetensors, with their .json beside); the shipped ones if not given.
        device: auto, cpu or cuda.

    Raises:
        DataError: missing or unusable weights; there is no silent fall-back.
        InputError: cuda asked for where there is none.
    """
    device = resolve_device(device)
    if path is not None:
        return load_network(path, device)
    with as_file(files("robust6dof") / "weights") as folder:
        shipped = Path(folder) / f"{SHIPPED}.safetensors"
        if not shipped.exists():
            raise DataError(
                shipped,
                "this build ships no weights",
                "Train with robust6dof train, and give the file with --weights",
            )
        return load_network(shipped, device)
