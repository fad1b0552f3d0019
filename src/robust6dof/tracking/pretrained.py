"""The weights in the box, or one's own."""

from __future__ import annotations

from importlib.resources import files
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
    chosen = Path(path) if path is not None else shipped_weights()
    if chosen is None:
        raise DataError(
            _shipped_file(),
            "this build ships no weights",
            "Train with robust6dof train, and give the file with --weights",
        )
    return load_network(chosen, device)


def shipped_weights() -> Path | None:
    """The file of the weights that this build holds, if any."""
    path = _shipped_file()
    return path if path.is_file() else None


def _shipped_file() -> Path:
    return Path(str(files("robust6dof"))) / "weights" / f"{SHIPPED}.safetensors"
