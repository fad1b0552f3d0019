"""The loop does what it says, and goes on after a kill as if nothing had happened."""

import copy
import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import load_file

from robust6dof.errors import DataError
from robust6dof.network.config import preset
from robust6dof.network.robust6dof_net import Robust6DofNet
from robust6dof.tracking.view import ViewConfig
from robust6dof.training.loop import TrainConfig, _step, train
from robust6dof.training.losses import LossConfig, pair_losses
from robust6dof.training.pair_batch import collate
from robust6dof.training.pairs import PairConfig, SyntheticPairs
from robust6dof.training.precision import answer
from robust6dof.training.recipe import Recipe, recipe_named
from robust6dof.training.train_log import TrainLog

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
    with pytest.raises(DataError, match="another configuration trains here: its seed"):
        train(config(1, seed=5), PAIRS, HELD_OUT, tmp_path)
    with pytest.raises(DataError, match="its data differ"):
        train(config(1, data={"data": "nocs"}), PAIRS, HELD_OUT, tmp_path)


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


WORKER = """
import sys
from pathlib import Path
sys.path.insert(0, sys.argv[2])
from training.test_loop import HELD_OUT, PAIRS, config
from robust6dof.training.loop import train
train(config(40), PAIRS, HELD_OUT, Path(sys.argv[1]))
"""


@pytest.mark.slow
def test_a_run_killed_at_any_moment_goes_on_as_if_it_had_not_been(tmp_path: Path) -> None:
    """kill -9 twice; the loss of every step, and the weights, are those of an unbroken run."""
    broken, tests = tmp_path / "broken", str(Path(__file__).parents[1])
    command = [sys.executable, "-c", WORKER, str(broken), tests]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    for step in (5, 15):
        process = subprocess.Popen(command, **quiet)
        while process.poll() is None and _logged(broken) < step:
            time.sleep(0.01)
        process.kill()
        assert process.wait() == -signal.SIGKILL, "it was still training"
    train(config(40), PAIRS, HELD_OUT, broken)
    train(config(40), PAIRS, HELD_OUT, tmp_path / "whole")
    whole, resumed = (_rows(tmp_path / name) for name in ("whole", "broken"))
    assert [row["step"] for row in resumed] == [row["step"] for row in whole]
    for first, second in zip(whole, resumed, strict=True):
        assert {**first, "seconds": 0} == {**second, "seconds": 0}
    weights = [load_file(tmp_path / n / "network.safetensors") for n in ("whole", "broken")]
    assert all(torch.equal(weights[0][key], weights[1][key]) for key in weights[0])


def _rows(run: Path) -> list[dict]:
    return [json.loads(line) for line in (run / "log.jsonl").read_text().splitlines()]


def _logged(run: Path) -> int:
    log = run / "log.jsonl"
    return log.read_bytes().count(b"\n") if log.exists() else 0


def test_the_log_of_a_killed_run_is_cut_back_to_its_checkpoint(tmp_path: Path) -> None:
    path = tmp_path / "log.jsonl"
    rows = [json.dumps({"step": step, "seconds": 2.0 * step, "loss": 1.0}) for step in (1, 2, 3, 4)]
    path.write_text("\n".join(rows) + "\n" + rows[0][:9])
    log = TrainLog(tmp_path, first=2, steps=9, quiet=False)
    log.losses(3, {"loss": 0.5}, every=1)
    log.close()
    kept = _rows(tmp_path)
    assert [(row["step"], row["loss"]) for row in kept] == [(1, 1.0), (2, 1.0), (3, 0.5)]
    assert kept[-1]["seconds"] >= 4.0


def test_progress_tells_every_loss_and_how_good_the_network_is(tmp_path: Path) -> None:
    train(config(2), PAIRS, HELD_OUT, tmp_path)
    rows = _rows(tmp_path)
    parts = {name for name, weight in vars(LossConfig().weights).items() if weight}
    assert parts | {"loss", "gradient", "step", "seconds"} == rows[0].keys()
    assert {f"validation/{name}_5deg5cm" for name in ("anchor", "step", "start")} < rows[-1].keys()
    folder = tmp_path / "checkpoint" / "step_0000002"
    files = {file.name for file in folder.iterdir()}
    assert files == {"network.safetensors", "ema.safetensors", "optimizer.safetensors"}
    assert json.loads((tmp_path / "checkpoint" / "latest.json").read_text())["step"] == 2
    assert json.loads((tmp_path / "network.json").read_text())["width"] == TINY.width


def test_tensorboard_shows_the_same(tmp_path: Path) -> None:
    events = pytest.importorskip("tensorboard.backend.event_processing.event_accumulator")
    train(config(2), PAIRS, HELD_OUT, tmp_path)
    board = events.EventAccumulator(str(tmp_path / "tensorboard")).Reload()
    shown = [event.value for event in board.Scalars("loss")]
    assert shown == pytest.approx([row["loss"] for row in _rows(tmp_path) if "loss" in row])
    assert "validation/anchor_5deg5cm" in board.Tags()["scalars"]


def test_without_anything_held_out_nothing_is_validated(tmp_path: Path) -> None:
    train(config(2), PAIRS, None, tmp_path)
    assert [row["step"] for row in _rows(tmp_path)] == [1, 2]


def _one_step(**recipe: float) -> tuple[Robust6DofNet, Robust6DofNet, Robust6DofNet]:
    """The network before a step and after it, and its running mean."""
    torch.manual_seed(0)
    net = Robust6DofNet(TINY)
    before, average = copy.deepcopy(net), copy.deepcopy(net)
    settings = TrainConfig(TINY, Recipe(batch=2, **recipe))
    _step(net, average, torch.optim.Adam(net.parameters()), BATCH, settings, 0)
    return before, net, average


BATCH = collate([PAIRS[0], PAIRS[1]])


def _gradient(net: Robust6DofNet) -> torch.Tensor:
    return torch.cat([p.grad.flatten() for p in net.parameters() if p.grad is not None])


def test_the_gradient_is_clipped_to_its_norm() -> None:
    free, clipped = (_gradient(_one_step(clip=clip)[1]).norm().item() for clip in (0.0, 0.5))
    assert free > 1.0
    assert clipped == pytest.approx(0.5, rel=1e-4)


def test_the_running_mean_follows_the_weights() -> None:
    before, net, average = _one_step(ema=0.9)
    for name, value in average.state_dict().items():
        expected = 0.9 * before.state_dict()[name] + 0.1 * net.state_dict()[name]
        torch.testing.assert_close(value, expected)


def test_without_a_running_mean_the_weights_themselves_are_kept() -> None:
    _, net, average = _one_step(ema=0.0)
    for name, value in average.state_dict().items():
        torch.testing.assert_close(value, net.state_dict()[name])


def test_mixed_precision_gives_nearly_the_same_losses_and_gradient() -> None:
    """In bfloat16 on the CPU, as on CUDA: the losses are computed in 32 bits."""
    torch.manual_seed(0)
    net = Robust6DofNet(TINY)
    losses, gradients = [], []
    batch = collate([PAIRS[i] for i in range(6)])
    for precision in ("fp32", "bf16"):
        output = answer(net, batch, precision)
        assert output.current.keypoints_cam.dtype == torch.float32
        loss, _ = pair_losses(output, batch.truth, LossConfig())
        net.zero_grad()
        loss.backward()
        losses.append(loss.item())
        gradients.append(_gradient(net))
    assert losses[1] != losses[0]
    assert losses[1] == pytest.approx(losses[0], rel=0.02)
    assert torch.cosine_similarity(*gradients, dim=0) > 0.95


@pytest.mark.skipif(not torch.cuda.is_available(), reason="there is no CUDA device here")
def test_a_run_on_cuda_is_in_mixed_precision(tmp_path: Path) -> None:
    train(config(3), PAIRS, HELD_OUT, tmp_path, device="cuda")
    assert all(np.isfinite(row["loss"]) for row in _rows(tmp_path) if "loss" in row)
