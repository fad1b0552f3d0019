"""What a step frees is there for the next one."""

import ctypes

import pytest
import torch

from robust6dof.network.device import keep_freed_memory


@pytest.mark.skipif(not hasattr(ctypes.CDLL(None), "mallopt"), reason="needs glibc")
def test_large_pieces_need_no_fresh_pages_the_second_time():
    resource = pytest.importorskip("resource")
    keep_freed_memory()

    def step() -> None:
        pieces = [torch.empty(2**20).fill_(1.0) for _ in range(8)]  # 4 MB each
        assert len(pieces) == 8

    for _ in range(3):
        step()
    before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    step()
    fresh = resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before
    assert fresh < 8 * 1024 // 8  # of the 8 × 1024 pages written


def test_other_c_libraries_are_left_as_they_are(monkeypatch):
    monkeypatch.setattr(ctypes, "CDLL", lambda name: object())
    keep_freed_memory()
