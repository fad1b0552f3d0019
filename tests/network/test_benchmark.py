"""The benchmark counts what it says it counts."""

import json

import torch
import torch.nn.functional as F

from robust6dof.cli import main
from robust6dof.network.benchmark import count_operations
from robust6dof.network.config import preset
from robust6dof.network.robust6dof_net import Robust6DofNet


def test_operations_of_a_product_and_of_attention():
    a, b = torch.rand(7, 11), torch.rand(11, 5)
    flop, byte = count_operations(lambda: a @ b)
    assert flop == 2 * 7 * 11 * 5
    assert byte == 4 * (7 * 11 + 11 * 5 + 7 * 5)
    q, k = torch.rand(1, 2, 16, 8), torch.rand(1, 2, 24, 8)
    flop, _ = count_operations(lambda: F.scaled_dot_product_attention(q, k, k))
    assert flop == 2 * 2 * 2 * 16 * 24 * 8


def test_views_move_no_bytes():
    a = torch.rand(7, 11)
    assert count_operations(lambda: a.transpose(0, 1)[2:4].reshape(2, 7))[1] == 0


def test_the_command_writes_what_it_measured(tmp_path, capsys):
    out = tmp_path / "bench.json"
    arguments = ["bench", "network", "--preset", "tiny", "--repeats", "2", "--threads", "1"]
    threads = torch.get_num_threads()
    try:
        assert main([*arguments, "--device", "cpu", "--json", str(out)]) == 0
    finally:
        torch.set_num_threads(threads)
    said = json.loads(out.read_text())
    net = Robust6DofNet(preset("tiny"))
    assert said["parameters"] == sum(p.numel() for p in net.parameters())
    assert (said["points"], said["keypoints"]) == (48, 16)
    assert (said["device"], said["threads"]) == ("cpu", 1)
    assert {"fusion", "augmentation", "assignment", "triplane", "rest"} <= set(said["stages_ms"])
    assert said["step_mflop"] > 0
    assert said["times_floor"] > 1
    assert json.loads(capsys.readouterr().out) == said


def test_a_tracker_is_timed_end_to_end(tmp_path, capsys):
    out = tmp_path / "track.json"
    main(["bench", "track", "--preset", "tiny", "--frames", "3", "--json", str(out)])
    measured = json.loads(out.read_text())
    assert measured["frames"] == 2
    assert measured["points"] == preset("tiny").points
    assert set(measured["stages_ms"]) == {"crop", "network", "matching", "solve", "registration"}
    assert measured["step_ms_p95"] >= measured["step_ms"] > 0
