"""Recordings that are there whole or not at all."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

PLAN_FILE = "plan.json"
"""What a recording was made from; written last."""


def is_made(folder: Path, plan: str) -> bool:
    """Whether the folder holds the whole recording of this plan."""
    path = folder / PLAN_FILE
    return path.is_file() and path.read_text() == plan


@contextmanager
def making(folder: Path, plan: str) -> Iterator[Path]:
    """A folder to write a recording into; it takes the place of `folder` once all is written.

    It lies beside the set, so that whoever reads that meanwhile meets whole recordings only.
    """
    out = folder.absolute().parent
    place = out.parent / f".{out.name}.{folder.name}.making"
    shutil.rmtree(place, ignore_errors=True)
    yield place
    (place / PLAN_FILE).write_text(plan)
    shutil.rmtree(folder, ignore_errors=True)
    out.mkdir(parents=True, exist_ok=True)
    os.replace(place, folder)
