"""Where the meshes and recordings for tests and evaluation lie: never in the repository."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

_DEFAULT = Path(__file__).resolve().parents[2] / "shared" / "data"


def shared_data(*parts: str) -> Path:
    """Path inside the shared data; skips the calling test where it is absent."""
    root = Path(os.environ.get("ROBUST6DOF_SHARED_DATA", _DEFAULT))
    path = root.joinpath(*parts)
    if not path.exists():
        pytest.skip(f"{path} is absent; set ROBUST6DOF_SHARED_DATA to the shared data folder")
    return path
