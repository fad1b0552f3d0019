"""The weights in the box, of categories and of YCB's objects, or one's own."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

from robust6dof.errors import DataError, InputError
from robust6dof.frames import YCB_OBJECTS
from robust6dof.network.checkpoint import load_network
from robust6dof.network.device import resolve_device
from robust6dof.network.robust6dof_net import Robust6DofNet

CATEGORY_WEIGHTS = "categories"
"""Name of the shipped weights of the six categories, and of those that users add."""
OBJECT_WEIGHTS = "ycb_objects"
"""Name of the shipped weights of the 21 YCB-Video objects."""


def category_or_object(category: str | None, object: str | None) -> str:
    """The one that is given: the name that prior, symmetry and shipped weights go by.

    Args:
        category: any with a prior.
        object: one of YCB-Video's.

    Raises:
        InputError: both, neither, or no such object.
    """
    if not object:
        if not category:
            raise InputError("say what is followed: a category, or a YCB object")
        return category
    if category and category != object:
        raise InputError(f"give the category '{category}' or the object '{object}', not both")
    if object not in YCB_OBJECTS:
        raise InputError(f"no YCB object '{object}'; there is: {', '.join(YCB_OBJECTS)}")
    return object


def load_pretrained(
    path: str | Path | None = None, device: str = "auto", category: str = ""
) -> Robust6DofNet:
    """A trained network, in evaluation mode; nothing is fetched.

    Args:
        path: weights (.safetensors, with their .json beside); the shipped ones if not given.
        device: auto, cpu or cuda.
        category: whose shipped ones; a YCB object has other weights than all else.

    Raises:
        DataError: missing or unusable weights; there is no silent fall-back.
        InputError: cuda asked for where there is none.
    """
    device = resolve_device(device)
    chosen = Path(path) if path is not None else shipped_weights(category)
    if chosen is None:
        whose = "of YCB objects " if category in YCB_OBJECTS else ""
        data = "--data ycb-video " if category in YCB_OBJECTS else ""
        raise DataError(
            _shipped_file(category),
            f"this build ships no weights {whose}".rstrip(),
            f"Train with robust6dof train {data}…, and give the file with --weights",
        )
    return load_network(chosen, device)


def shipped_weights(category: str = "") -> Path | None:
    """The file of the weights that this build holds for a category or YCB object, if any."""
    path = _shipped_file(category)
    return path if path.is_file() else None


def _shipped_file(category: str) -> Path:
    name = OBJECT_WEIGHTS if category in YCB_OBJECTS else CATEGORY_WEIGHTS
    return Path(str(files("robust6dof"))) / "weights" / f"{name}.safetensors"
