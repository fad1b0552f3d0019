"""Functions on torch's threads: every task once, by several threads, errors not lost."""

import threading
import time

import pytest
import torch

from robust6dof.network import torch_threads
from robust6dof.network.torch_threads import for_each


@pytest.fixture(params=[1, 2, 3])
def threads(request):
    before = torch.get_num_threads()
    torch.set_num_threads(request.param)
    yield request.param
    torch.set_num_threads(before)


@pytest.fixture(params=["openmp", "none"])
def openmp(request, monkeypatch):
    if request.param == "none":
        monkeypatch.setattr(torch_threads, "_openmp_parallel", lambda: None)
    return request.param == "openmp" and torch_threads._openmp_parallel() is not None


@pytest.mark.parametrize("count", [0, 1, 2, 37])
def test_each_task_is_done_once(threads, openmp, count):
    done = []
    for_each(done.append, range(count))
    assert sorted(done) == list(range(count))


def test_as_many_threads_as_torch_has_take_part(threads, openmp):
    seen = set()

    def work(_: int) -> None:
        seen.add(threading.get_ident())
        time.sleep(0.02)

    for_each(work, range(12))
    assert len(seen) == (threads if openmp else 1)


def test_an_error_in_a_task_is_raised(threads, openmp):
    def work(task: int) -> None:
        if task == 5:
            raise ValueError("task 5")

    with pytest.raises(ValueError, match="task 5"):
        for_each(work, range(8))


def test_torch_goes_on_working_in_between(threads):
    a = torch.rand(200, 300)
    found = torch.zeros(4, 200, 200)

    def work(task: int) -> None:
        torch.mm(a, a.mT, out=found[task])

    for_each(work, range(4))
    torch.testing.assert_close(found, (a @ a.mT).expand(4, -1, -1))
