"""Training goes on after a kill as if nothing had happened, and two processes act as one."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file

from robust6dof.errors import DataError
from robust6dof.network.config import preset
from robust6dof.network.robust6dof_net import Robust6DofNet
from robust6dof.tracking.view import ViewConfig
from robust6dof.training.loop import TrainConfig, train
from robust6dof.training.losses import LossConfig, pair_losses
from robust6dof.training.pair_batch import collate
from robust6dof.training.pairs import PairConfig, SyntheticPairs
from robust6dof.training.recipe import Recipe, recipe_named

TINY = preset("tiny")
VIEW = ViewConfig(points=TINY.points, crop_px=TINY.crop_px)
PAIRS = SyntheticPairs(VIEW, TINY.prior_points, 0, 100, PairConfig(object_pool=2, largest_px=64))
HELD_OUT = SyntheticPairs(VIEW, TINY.prior_points, 1, 4, PairConfig(object_pool=2, largest_px=64))


def config(steps: int, **changes: object) -> TrainConfig:
    recipe = Recipe(batch=2, steps=steps, schedule="cosine", clip=1.0, ema=0.9)
    return TrainConfig(TINY, recipe, log_every=1, save_every=2, validate_every=100, **changes)


def test_a_pair_depends_on_its_number_alone() -> None:
    again = SyntheticPairs(VIEW, TINY.prior_points, 0, 100, PAIRS.config)
    a, b = PAIRS[7], again[7]
    assert torch.equal(a.current.points, b.current.points)
    assert torch.equal(a.truth.T_cam_obj_cur, b.truth.T_cam_obj_cur)
    assert not torch.equal(a.current.points, PAIRS[13].current.points)


def test_the_truth_of_a_pair_explains_its_points() -> None:
    """Points marked as on the object lie inside the true box, under the true transforms."""
    pairs = [PAIRS[i] for i in range(12)]
    batch = collate(pairs)
    view, truth = batch.current, batch.truth
    R_pred, t_pred = view.T_cam_pred[:, :3, :3], view.T_cam_pred[:, :3, 3]
    points_cam = view.scale[:, None, None] * view.points @ R_pred.mT + t_pred[:, None]
    R, t = truth.T_cam_obj_cur[:, :3, :3], truth.T_cam_obj_cur[:, :3, 3]
    canonical = (points_cam - t[:, None]) @ R / truth.scale[:, None, None]
    on_object = canonical[truth.on_object_cur]
    assert on_object.abs().max() < 0.62, "the half diagonal, and the depth's noise"
    assert truth.on_object_cur.float().mean() > 0.2


def test_a_resumed_run_equals_an_unbroken_one(tmp_path: Path) -> None:
    train(config(5), PAIRS, HELD_OUT, tmp_path / "whole")
    stops = iter([False, False, True])
    train(config(5), PAIRS, HELD_OUT, tmp_path / "broken", stop=lambda: next(stops))
    train(config(5), PAIRS, HELD_OUT, tmp_path / "broken")
    whole, broken = (
        load_file(tmp_path / name / "network.safetensors") for name in ("whole", "broken")
    )
    assert all(torch.equal(whole[key], broken[key]) for key in whole)
    losses = [
        {row["step"]: row["loss"] for row in map(json.loads, log) if "loss" in row}
        for log in (
            (tmp_path / name / "log.jsonl").read_text().splitlines() for name in ("whole", "broken")
        )
    ]
    assert losses[0] == losses[1]


def test_another_configuration_is_refused(tmp_path: Path) -> None:
    train(config(1), PAIRS, HELD_OUT, tmp_path)
    with pytest.raises(DataError, match="another configuration"):
        train(config(1, seed=5), PAIRS, HELD_OUT, tmp_path)


def test_schedules() -> None:
    paper = recipe_named("paper")
    assert (paper.learning_rate, paper.batch, paper.rate(0), paper.rate(49_999)) == (
        1e-3,
        32,
        1e-3,
        1e-3,
    )
    cosine = Recipe(steps=1000, schedule="cosine")
    assert cosine.rate(0) < cosine.rate(19) == pytest.approx(1e-3)
    assert cosine.rate(999) < 2e-5


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
    launch = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc-per-node=2"]
    done = subprocess.run(
        [*launch, str(script), str(tmp_path / "gradient.pt")],
        env={**os.environ, "OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
    )
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
