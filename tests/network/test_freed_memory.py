"""Asking the C library to keep freed memory: only where it can be asked."""

import ctypes
from types import SimpleNamespace

from robust6dof.network.freed_memory import keep_freed_memory


def test_glibc_is_asked_to_keep_64_mb_of_pieces_up_to_32(monkeypatch):
    asked = []
    library = SimpleNamespace(mallopt=lambda *option: asked.append(option))
    monkeypatch.setattr(ctypes, "CDLL", lambda name: library)
    keep_freed_memory()
    assert asked == [(-3, 32 * 2**20), (-1, 64 * 2**20)]


def test_other_c_libraries_are_left_as_they_are(monkeypatch):
    opened = []
    monkeypatch.setattr(ctypes, "CDLL", lambda name: opened.append(name) or object())
    keep_freed_memory()
    assert opened == [None]
