"""Weights on disk: NAME.safetensors beside NAME.json (the configuration)."""

from __future__ import annotations

from pathlib import Path

import torch
from safetensors import SafetensorError
from safetensors.torch import load_file, save_file

from robust6dof.errors import DataError, InputError
from robust6dof.network.config import NetworkConfig
from robust6dof.network.robust6dof_net import Robust6DofNet


def save_network(net: Robust6DofNet, path: str | Path, half: bool = False) -> Path:
    """Write weights to `path` (.safetensors) and the configuration beside it (.json).

    Args:
        half: store in 16 bits, half the size.
    """
    path = Path(path).with_suffix(".safetensors")
    path.parent.mkdir(parents=True, exist_ok=True)
    dtype = torch.float16 if half else torch.float32
    state = {name: value.detach().cpu().to(dtype) for name, value in net.state_dict().items()}
    save_file({name: value.contiguous() for name, value in state.items()}, path)
    path.with_suffix(".json").write_text(net.config.to_json() + "\n")
    return path


def load_network(path: str | Path, device: str | torch.device = "cpu") -> Robust6DofNet:
    """Read a network that `save_network` wrote, in evaluation mode and float32.

    Raises:
        DataError: a file is missing or damaged, or weights and configuration do not fit.
    """
    path = Path(path).with_suffix(".safetensors")
    net = Robust6DofNet(_read_config(path.with_suffix(".json")))
    if not path.exists():
        raise DataError(path, "no such weights", "Give the path that save_network or train wrote")
    try:
        state = load_file(path)
    except (SafetensorError, OSError) as error:
        raise DataError(path, f"not a safetensors file ({error})", "Copy it again") from error
    _check_state(path, net, state)
    net.load_state_dict({name: value.float() for name, value in state.items()})
    return net.to(device).eval()


def _read_config(path: Path) -> NetworkConfig:
    if not path.exists():
        raise DataError(path, "no configuration beside the weights", "Copy the .json along")
    try:
        return NetworkConfig.from_json(path.read_text())
    except (InputError, TypeError) as error:
        raise DataError(path, str(error), "Load it with the version that wrote it") from error


def _check_state(path: Path, net: Robust6DofNet, state: dict[str, torch.Tensor]) -> None:
    expected = net.state_dict()
    missing, unknown = sorted(set(expected) - set(state)), sorted(set(state) - set(expected))
    odd = [name for name in expected if name in state and expected[name].shape != state[name].shape]
    if missing or unknown or odd:
        first = (missing + unknown + odd)[0]
        raise DataError(
            path,
            f"weights do not fit their configuration: {len(missing)} missing, {len(unknown)} "
            f"unknown, {len(odd)} of another size (first: {first})",
            "Use the .json that was written with them",
        )
