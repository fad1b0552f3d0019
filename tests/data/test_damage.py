"""Whatever happens to a file's bytes, the reader either reads it or names it: nothing else."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest

from data.nocs_files import annotated, make_instances, write_frame, write_pickle
from data.recordings import make_recording
from robust6dof.data import open_dataset
from robust6dof.errors import DataError


def damage(content: bytes, rng: np.random.Generator) -> bytes:
    """Cut the end off, overwrite a few bytes, or insert some."""
    place, noise = int(rng.integers(len(content))), rng.bytes(int(rng.integers(1, 9)))
    kept_from = (len(content), place + len(noise), place)[rng.integers(3)]
    return content[:place] + (noise if kept_from < len(content) else b"") + content[kept_from:]


def read_all(path: Path) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        for sequence in open_dataset(path).sequences:
            for index in range(len(sequence)):
                sequence.frame(index)
                sequence.truth(index)
                sequence.missing(index)


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    path = make_recording(tmp_path / "recording", count=2)
    (path / "stamps.txt").write_text("97 1\n100 2\n")
    (path / "dist_coeffs.txt").write_text("plumb_bob 0.1 0 0 0\n")
    return path


@pytest.fixture
def nocs(tmp_path: Path) -> Path:
    instances = make_instances()
    write_frame(tmp_path / "nocs" / "real_test" / "scene_1", "0003", instances)
    gts = tmp_path / "nocs" / "gts" / "real_test" / "results_real_test_scene_1_0003.pkl"
    write_pickle(gts, {"gt_RTs": np.stack([one.RT for one in annotated(instances)])})
    return tmp_path / "nocs"


def damage_error(path: Path) -> DataError | None:
    try:
        read_all(path)
    except DataError as error:
        return error
    return None


@pytest.mark.parametrize(("name", "count"), [("recording", 120), ("nocs", 40)])
def test_damaged_files_are_named_or_read(
    name: str, count: int, request: pytest.FixtureRequest
) -> None:
    path: Path = request.getfixturevalue(name)
    rng = np.random.default_rng(11)
    files = sorted(file for file in path.rglob("*") if file.is_file())
    small = [file for file in files if file.stat().st_size < 50_000]
    errors = []
    for _ in range(count):
        file = small[rng.integers(len(small))]
        content = file.read_bytes()
        file.write_bytes(damage(content, rng))
        errors.append(damage_error(path))
        file.write_bytes(content)
    named = [error for error in errors if error is not None]
    assert len(named) > count / 3
    assert all(str(error.path).startswith(str(path)) and error.remedy for error in named)
    read_all(path)
