"""Other people's pickles: numpy arrays and builtin containers, and nothing that runs."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import IO, Any

import numpy as np

from robust6dof.errors import DataError

_NUMPY_MODULES = ("numpy.core", "numpy._core")
_ARRAYS = ("multiarray", "_multiarray_umath")
_BUILTINS = ("set", "frozenset", "bytes", "bytearray", "complex", "slice")
ALLOWED = frozenset(
    {
        ("numpy", "ndarray"),
        ("numpy", "dtype"),
        *((f"{module}.{name}", "_reconstruct") for module in _NUMPY_MODULES for name in _ARRAYS),
        *((f"{module}.{name}", "scalar") for module in _NUMPY_MODULES for name in _ARRAYS),
        *((f"{module}.numeric", "_frombuffer") for module in _NUMPY_MODULES),
        # How Python 3 writes bytes, the content of arrays, for protocol 2 and below.
        ("_codecs", "encode"),
        *((module, name) for module in ("builtins", "__builtin__") for name in _BUILTINS),
        ("collections", "OrderedDict"),
    }
)
"""All that a stored pickle may name; none of it runs foreign code."""


class _RestrictedUnpickler(pickle.Unpickler):
    def find_class(self, module_name: str, global_name: str) -> Any:
        if (module_name, global_name) not in ALLOWED:
            raise pickle.UnpicklingError(f"it asks for {module_name}.{global_name}")
        if module_name.startswith("numpy.core"):
            module_name = module_name.replace("numpy.core", "numpy._core")
        return super().find_class(module_name, global_name)


def read_pickle(path: str | Path) -> Any:
    """Read a pickle of numpy arrays and builtin containers, of Python 2 or 3.

    Raises:
        DataError: missing, truncated, or naming anything else (which is refused, not run).
    """
    path = Path(path)
    if not path.is_file():
        raise DataError(path, "the file is missing", "Get it again from the data set")
    with path.open("rb") as file:
        return _load(file, path)


def read_npy(path: str | Path) -> Any:
    """Read a `.npy` file; an array of objects through the restricted unpickler.

    Raises:
        DataError: missing, truncated, or naming anything but arrays and builtin containers.
    """
    path = Path(path)
    if not path.is_file():
        raise DataError(path, "the file is missing", "Get it again from the data set")
    try:
        with path.open("rb") as file:
            version = np.lib.format.read_magic(file)
            read_header = np.lib.format.read_array_header_2_0
            if version == (1, 0):
                read_header = np.lib.format.read_array_header_1_0
            shape, _, dtype = read_header(file)
            if dtype.hasobject:
                values = _load(file, path)
                return np.asarray(values, dtype=object).reshape(shape)
        return np.load(path, allow_pickle=False)
    except (ValueError, EOFError) as error:
        raise DataError(path, f"not a .npy file ({error})", "Get it again") from error


def _load(file: IO[bytes], path: Path) -> Any:
    try:
        return _RestrictedUnpickler(file, encoding="latin1").load()
    except pickle.UnpicklingError as error:
        raise DataError(
            path,
            f"refused: {error}, but only numpy arrays and builtin containers are read",
            "Do not open it with pickle unless you trust who made it",
        ) from error
    except Exception as error:  # a torn pickle can raise anything
        raise DataError(path, f"truncated or no pickle ({error})", "Get it again") from error
