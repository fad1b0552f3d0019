"""Weights and configuration go to disk and back; what does not fit says so."""

from dataclasses import replace

import pytest
import torch

from robust6dof.errors import DataError
from robust6dof.network.checkpoint import load_network, save_network
from robust6dof.network.config import preset
from robust6dof.network.robust6dof_net import Robust6DofNet


@pytest.fixture
def saved(tmp_path):
    net = Robust6DofNet(preset("tiny"))
    return net, save_network(net, tmp_path / "weights")


def test_round_trip(saved):
    net, path = saved
    loaded = load_network(path)
    assert loaded.config == net.config
    assert not loaded.training
    for name, value in net.state_dict().items():
        assert torch.equal(loaded.state_dict()[name], value)


def test_half_precision_halves_the_file(saved, tmp_path):
    net, path = saved
    half = save_network(net, tmp_path / "half", half=True)
    assert half.stat().st_size < 0.7 * path.stat().st_size
    for name, value in load_network(half).state_dict().items():
        assert value.dtype == torch.float32
        torch.testing.assert_close(value, net.state_dict()[name], atol=1e-3, rtol=1e-3)


def test_a_mismatch_is_a_clear_error(saved):
    net, path = saved
    path.with_suffix(".json").write_text(replace(net.config, width=64).to_json())
    with pytest.raises(DataError, match="do not fit their configuration"):
        load_network(path)
    path.with_suffix(".json").write_text('{"colour": 1}')
    with pytest.raises(DataError, match="unknown network settings"):
        load_network(path)
    path.with_suffix(".json").unlink()
    with pytest.raises(DataError, match="no configuration"):
        load_network(path)


def test_missing_and_damaged_weights(saved):
    _, path = saved
    path.write_bytes(path.read_bytes()[:100])
    with pytest.raises(DataError, match="not a safetensors file"):
        load_network(path)
    path.unlink()
    with pytest.raises(DataError, match="no such weights"):
        load_network(path)
