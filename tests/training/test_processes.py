"""Two processes that train together act as one."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file

from robust6dof.network.robust6dof_net import Robust6DofNet
from robust6dof.training.losses import LossConfig, pair_losses
from robust6dof.training.pair_batch import collate
from training.test_loop import PAIRS, TINY


@pytest.mark.slow
def test_two_processes_give_the_gradient_of_one(tmp_path: Path) -> None:
    """DDP's gradient is the mean of the halves' gradients, which one process computes here."""
    script = tmp_path / "worker.py"
    script.write_text(
        "import sys\nfrom pathlib import Path\n"
        "import torch, torch.distributed as dist\n"
        "from torch.nn.parallel import DistributedDataParallel\n"
        "from robust6dof.network.config import preset\n"
        "from robust6dof.network.robust6dof_net import Robust6DofNet\n"
        "from robust6dof.tracking.view import ViewConfig\n"
        "from robust6dof.training.losses import LossConfig, pair_losses\n"
        "from robust6dof.training.pair_batch import collate\n"
        "from robust6dof.training.pairs import PairConfig, SyntheticPairs\n"
        "dist.init_process_group('gloo')\n"
        "rank = dist.get_rank()\n"
        "tiny = preset('tiny')\n"
        "pairs = SyntheticPairs(ViewConfig(tiny.points, tiny.crop_px), tiny.prior_points, 0, 100,\n"
        "                       PairConfig(object_pool=2, largest_px=64))\n"
        "torch.manual_seed(0)\n"
        "net = DistributedDataParallel(Robust6DofNet(tiny), find_unused_parameters=True)\n"
        "batch = collate([pairs[2 * rank], pairs[2 * rank + 1]])\n"
        "loss, _ = pair_losses(net(batch.previous, batch.current, batch.prior), batch.truth,\n"
        "                      LossConfig())\n"
        "loss.backward()\n"
        "if rank == 0:\n"
        "    torch.save({n: p.grad for n, p in net.module.named_parameters()}, sys.argv[1])\n"
        "dist.destroy_process_group()\n"
    )
    done = _two_processes(str(script), str(tmp_path / "gradient.pt"))
    assert done.returncode == 0, done.stderr[-2000:]
    shared = torch.load(tmp_path / "gradient.pt", weights_only=True)
    torch.manual_seed(0)
    net = Robust6DofNet(TINY)
    for half in (0, 2):
        batch = collate([PAIRS[half], PAIRS[half + 1]])
        output = net(batch.previous, batch.current, batch.prior)
        (0.5 * pair_losses(output, batch.truth, LossConfig())[0]).backward()
    for name, parameter in net.named_parameters():
        if parameter.grad is not None:
            torch.testing.assert_close(shared[name], parameter.grad, rtol=1e-4, atol=1e-6)


def _two_processes(*command: str) -> subprocess.CompletedProcess[str]:
    launch = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc-per-node=2"]
    threads = {"OMP_NUM_THREADS": "1"}
    return subprocess.run(
        [*launch, *command], env=os.environ | threads, capture_output=True, text=True
    )


@pytest.mark.slow
def test_two_processes_run_the_command_and_go_on_with_it(tmp_path: Path) -> None:
    """The second run finds nothing left to do; a batch that cannot be shared is refused."""
    few = [
        "--preset",
        "tiny",
        "--epoch",
        "4",
        "--held-out",
        "2",
        "--workers",
        "0",
        "--device",
        "cpu",
    ]
    command = ["-m", "robust6dof", "train", *few, "--steps", "3", "--out", str(tmp_path / "run")]
    for _ in range(2):
        done = _two_processes(*command, "--batch", "2")
        assert done.returncode == 0, done.stderr[-2000:]
    rows = (tmp_path / "run" / "log.jsonl").read_text().splitlines()
    assert len(rows) == 1, "one validation, logged by one process"
    weights = load_file(tmp_path / "run" / "network.safetensors")
    assert all(value.isfinite().all() for value in weights.values())
    odd = _two_processes(*command[:-1], str(tmp_path / "odd"), "--batch", "3")
    assert odd.returncode != 0
    assert "cannot be shared by 2 processes" in odd.stderr
