"""Pickles from strangers: what is read, and that nothing runs."""

from __future__ import annotations

import os
import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from robust6dof.data.restricted_pickle import read_npy, read_pickle
from robust6dof.errors import DataError

CONTENT = {
    "gt_RTs": np.arange(32.0).reshape(2, 4, 4),
    "gt_class_ids": np.array([1, 6], dtype=np.int32),
    "names": ["a", "b"],
    "empty": np.zeros((0, 3)),
    "ids": {1, 2},
    "score": np.float64(0.5),
    "objects": np.array([None, "text", (1, 2)], dtype=object),
    "raw": b"\xff\x00",
    "flags": np.array([True, False]),
}


class RunsCommand:
    def __init__(self, command: str) -> None:
        self.command = command

    def __reduce__(self) -> tuple[Any, ...]:
        return os.system, (self.command,)


class CallsBuiltin:
    def __reduce__(self) -> tuple[Any, ...]:
        return eval, ("1 + 1",)


def assert_same(values: Any) -> None:
    assert values.keys() == CONTENT.keys()
    for key, expected in CONTENT.items():
        if isinstance(expected, np.ndarray):
            assert values[key].dtype == expected.dtype
            np.testing.assert_array_equal(values[key], expected)
        else:
            assert values[key] == expected


@pytest.mark.parametrize("protocol", range(pickle.HIGHEST_PROTOCOL + 1))
def test_arrays_and_containers_are_read(tmp_path: Path, protocol: int) -> None:
    (tmp_path / "a.pkl").write_bytes(pickle.dumps(CONTENT, protocol))
    assert_same(read_pickle(tmp_path / "a.pkl"))


def test_pickles_of_older_numpy_are_read(tmp_path: Path) -> None:
    """numpy 1 wrote numpy.core where numpy 2 writes numpy._core."""
    content = pickle.dumps(CONTENT, 2).replace(b"numpy._core", b"numpy.core")
    assert b"numpy.core" in content
    (tmp_path / "a.pkl").write_bytes(content)
    assert_same(read_pickle(tmp_path / "a.pkl"))


def test_python_2_text_is_read(tmp_path: Path) -> None:
    (tmp_path / "a.pkl").write_bytes(b"(dp0\nS'model'\np1\nS'mug_\\xe9'\np2\ns.")
    assert read_pickle(tmp_path / "a.pkl") == {"model": "mug_é"}


@pytest.mark.parametrize("protocol", range(pickle.HIGHEST_PROTOCOL + 1))
def test_a_malicious_pickle_is_refused_and_does_not_run(tmp_path: Path, protocol: int) -> None:
    marker = tmp_path / "ran"
    for number, payload in enumerate(
        [
            RunsCommand(f"touch {marker}"),
            {"gt_RTs": [np.zeros(3), RunsCommand(f"touch {marker}")]},
            np.array([RunsCommand(f"touch {marker}")], dtype=object),
        ]
    ):
        path = tmp_path / f"{number}.pkl"
        path.write_bytes(pickle.dumps(payload, protocol))
        with pytest.raises(DataError, match=r"refused: it asks for \w+\.system"):
            read_pickle(path)
    assert not marker.exists()


@pytest.mark.parametrize(
    "payload",
    [
        CallsBuiltin(),
        Path("x"),
        np.load,
        pickle.loads,
        getattr,
        np.random.default_rng,
    ],
)
def test_only_arrays_and_containers_are_allowed(tmp_path: Path, payload: Any) -> None:
    (tmp_path / "a.pkl").write_bytes(pickle.dumps(payload))
    with pytest.raises(DataError, match="refused"):
        read_pickle(tmp_path / "a.pkl")


def test_truncated_and_missing_pickles_are_named(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"a\.pkl: the file is missing"):
        read_pickle(tmp_path / "a.pkl")
    (tmp_path / "a.pkl").write_bytes(pickle.dumps(CONTENT)[:-20])
    with pytest.raises(DataError, match=r"a\.pkl"):
        read_pickle(tmp_path / "a.pkl")
    (tmp_path / "a.pkl").write_bytes(b"")
    with pytest.raises(DataError, match="truncated"):
        read_pickle(tmp_path / "a.pkl")


def test_npy_of_plain_and_of_object_arrays(tmp_path: Path) -> None:
    np.save(tmp_path / "plain.npy", np.arange(6.0).reshape(2, 3))
    np.testing.assert_array_equal(read_npy(tmp_path / "plain.npy"), [[0, 1, 2], [3, 4, 5]])
    np.save(tmp_path / "dict.npy", np.array(CONTENT, dtype=object), allow_pickle=True)
    assert_same(read_npy(tmp_path / "dict.npy").item())


def test_a_malicious_npy_is_refused(tmp_path: Path) -> None:
    marker = tmp_path / "ran"
    payload = np.array([RunsCommand(f"touch {marker}")], dtype=object)
    np.save(tmp_path / "a.npy", payload, allow_pickle=True)
    with pytest.raises(DataError, match="refused"):
        read_npy(tmp_path / "a.npy")
    assert not marker.exists()
    (tmp_path / "b.npy").write_bytes(b"no array")
    with pytest.raises(DataError, match=r"not a \.npy file"):
        read_npy(tmp_path / "b.npy")
