"""How fast one step of the network is, and how far that is from what the machine could do."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor
from torch.utils._python_dispatch import TorchDispatchMode
from torch.utils._pytree import tree_iter
from torch.utils.flop_counter import FlopCounterMode

from robust6dof.network.config import NetworkConfig
from robust6dof.network.inputs import ViewBatch
from robust6dof.network.robust6dof_net import Robust6DofNet

STAGES = ("fusion", "augmentation", "point_head", "assignment", "unsupervised", "triplane")
"""Parts of the network that are timed by name, where the configuration has them."""


@dataclass(frozen=True)
class NetworkBenchmark:
    """One step (encode the new frame, match it with the last one), batch 1."""

    preset: str
    parameters: int
    points: int
    prior_points: int
    keypoints: int
    device: str
    threads: int
    repeats: int
    step_ms: float
    """Median time of a step."""
    step_ms_p95: float
    """95th percentile."""
    prior_ms: float
    """Encoding the prior, once per track."""
    stages_ms: dict[str, float]
    """Median time of each part; `rest` is what lies between them."""
    step_mflop: float
    """Floating-point operations of a step (a multiply-add is two), max filter included."""
    step_mbyte: float
    """Bytes read and written by a step's operations, each counted as unfused."""
    peak_gflop_per_s: float
    """Of a large matrix product on this machine and these threads."""
    peak_gbyte_per_s: float
    """Of a large copy."""
    floor_ms: float
    """The larger of operations over the first peak and bytes over the second."""
    times_floor: float
    """`step_ms` over `floor_ms`."""


def benchmark_network(
    config: NetworkConfig, name: str, device: str = "cpu", seed: int = 0, repeats: int = 50
) -> NetworkBenchmark:
    """Time a network of random weights on random input; threads are torch's."""
    torch.manual_seed(seed)
    net = Robust6DofNet(config).to(device).eval()
    with torch.inference_mode():
        prior_points = torch.rand(1, config.prior_points, 3, device=device) - 0.5
        prior = net.encode_prior(prior_points)
        view = _random_view(config).to(device)
        previous = net.encode(view, prior)

        def step() -> None:
            net.match(previous, net.encode(view, prior, previous))

        times = _time(step, repeats, device)
        stages = _time_stages(net, step, max(3, repeats // 3), device)
        prior_ms = float(np.median(_time(lambda: net.encode_prior(prior_points), 5, device)))
        flop, byte = count_operations(step)
    flop += _max_filter_flop(config)
    peak_flop, peak_byte = _peaks(device)
    floor_ms = 1e3 * max(flop / peak_flop, byte / peak_byte)
    step_ms = float(np.median(times))
    stages["rest"] = step_ms - sum(stages.values())
    return NetworkBenchmark(
        preset=name,
        parameters=sum(p.numel() for p in net.parameters()),
        points=config.points,
        prior_points=config.prior_points,
        keypoints=config.keypoints,
        device=torch.cuda.get_device_name() if device == "cuda" else "cpu",
        threads=torch.get_num_threads(),
        repeats=repeats,
        step_ms=step_ms,
        step_ms_p95=float(np.percentile(times, 95)),
        prior_ms=prior_ms,
        stages_ms=stages,
        step_mflop=flop / 1e6,
        step_mbyte=byte / 1e6,
        peak_gflop_per_s=peak_flop / 1e9,
        peak_gbyte_per_s=peak_byte / 1e9,
        floor_ms=floor_ms,
        times_floor=step_ms / floor_ms,
    )


def count_operations(function: Callable[[], object]) -> tuple[float, float]:
    """Floating-point operations of matrix products, and bytes in and out of every operation."""
    traffic = _Traffic()
    attention: Any = torch.ops.aten._scaled_dot_product_flash_attention_for_cpu
    counter = FlopCounterMode(display=False, custom_mapping={attention: _attention_flop})
    with torch.no_grad(), counter, traffic:
        function()
    return float(counter.get_total_flops()), traffic.bytes


def _attention_flop(
    query: torch.Size, key: torch.Size, value: torch.Size, *_: Any, **__: Any
) -> int:
    batch, heads, rows, width = query
    return 2 * batch * heads * rows * key[-2] * (width + value[-1])


def _max_filter_flop(config: NetworkConfig) -> float:
    """A product and a comparison for each pair and channel (and a sum, with an offset)."""
    pairs = config.points * config.width
    temporal = 2 * pairs * config.points if config.temporal_encoder else 0
    shape = 3 * pairs * config.prior_points if config.shape_filter == "max" else 0
    return float(temporal + shape)


class _Traffic(TorchDispatchMode):
    """Adds up the sizes of the tensors that go into and come out of each operation."""

    def __init__(self) -> None:
        super().__init__()
        self.bytes = 0.0

    def __torch_dispatch__(
        self, func: Any, types: Any, args: Any = (), kwargs: Any = None
    ) -> object:
        out = func(*args, **(kwargs or {}))
        if not _is_view(func):
            for value in tree_iter((args, kwargs, out)):
                if isinstance(value, Tensor):
                    self.bytes += value.numel() * value.element_size()
        return out


def _is_view(func: Any) -> bool:
    return any(a.alias_info and not a.alias_info.is_write for a in func._schema.arguments)


def _time_stages(
    net: Robust6DofNet, step: Callable[[], None], repeats: int, device: str
) -> dict[str, float]:
    """Median time [ms] of each named part inside real steps."""
    parts = {name: module for name, module in net.named_children() if name in STAGES}
    seen: dict[str, list[float]] = {name: [] for name in parts}
    hooks = []
    for name, module in parts.items():
        hooks.append(
            module.register_forward_pre_hook(lambda *_, n=name: seen[n].append(_now(device)))
        )
        hooks.append(
            module.register_forward_hook(
                lambda *_, n=name: seen[n].append(1e3 * (_now(device) - seen[n].pop()))
            )
        )
    for _ in range(repeats):
        step()
    for hook in hooks:
        hook.remove()
    return {name: float(np.median(times)) for name, times in seen.items()}


def _time(function: Callable[[], object], repeats: int, device: str) -> list[float]:
    """Times [ms] of single calls, after two that do not count."""
    times = []
    for _ in range(repeats + 2):
        start = _now(device)
        function()
        times.append(1e3 * (_now(device) - start))
    return times[2:]


def _now(device: str) -> float:
    if device == "cuda":
        torch.cuda.synchronize()
    return time.perf_counter()


def _peaks(device: str, size: int = 1024) -> tuple[float, float]:
    """Operations per second of a matrix product, bytes per second of a copy: the best of ten."""
    a, b = torch.rand(size, size, device=device), torch.rand(size, size, device=device)
    product_ms = min(_time(lambda: a @ b, 10, device))
    large = torch.rand(32 * size * size // 4, device=device)
    out = torch.empty_like(large)
    copy_ms = min(_time(lambda: out.copy_(large), 10, device))
    return 2e3 * size**3 / product_ms, 2e3 * large.numel() * 4 / copy_ms


def _random_view(config: NetworkConfig) -> ViewBatch:
    return ViewBatch(
        points=torch.rand(1, config.points, 3) - 0.5,
        rgb=torch.rand(1, 3, config.crop_px, config.crop_px),
        pixels=torch.rand(1, config.points, 2) * (config.crop_px - 1),
        T_cam_pred=torch.eye(4)[None],
        scale=torch.tensor([0.2]),
    )
