"""Asking the C library to keep freed memory: only where it can be asked."""

import ctypes

from robust6dof.network.freed_memory import keep_freed_memory


def test_other_c_libraries_are_left_as_they_are(monkeypatch):
    monkeypatch.setattr(ctypes, "CDLL", lambda name: object())
    keep_freed_memory()
