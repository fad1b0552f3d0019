"""Fine-tune torchvision's Mask R-CNN on the synthetic world and export it to ONNX."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from pickle import UnpicklingError
from typing import Any

import numpy as np
import torch

from robust6dof.errors import DataError
from robust6dof.frames import CATEGORIES
from robust6dof.tracking.segmenters.onnx_detector import CATEGORIES_KEY, OUTPUTS
from robust6dof.tracking.segmenters.torchvision_detector import make_mask_rcnn
from robust6dof.training.segmenter_images import LabelledImage, draw_labelled_image

_EXPORT_OPSET = 17


@dataclass(frozen=True)
class SegmenterTraining:
    """torchvision's own recipe for detection, a batch scaled to one GPU."""

    steps: int = 20_000
    batch: int = 8
    learning_rate: float = 0.01
    """Of SGD with momentum 0.9; falls to a tenth after 60 %, and again after 90 % of the steps."""
    weight_decay: float = 1e-4
    warm_up: int = 500
    """Steps over which the rate rises."""
    clip: float = 10.0
    """Largest norm of the gradient."""
    size_px: tuple[int, int] = (480, 640)
    """Shorter and longer side that images are scaled to."""

    def rate(self, step: int) -> float:
        """Learning rate at a step."""
        falls = sum(step >= share * self.steps for share in (0.6, 0.9))
        return self.learning_rate * min(1.0, (step + 1) / self.warm_up) * 0.1**falls


def train_segmenter(
    out: Path,
    config: SegmenterTraining,
    *,
    start: Path | None = None,
    seed: int = 0,
    device: str = "cpu",
    workers: int = 1,
    report: Callable[[int, float], None] = lambda step, loss: None,
) -> Path:
    """Train; write segmenter.pt and segmenter.onnx into `out`; return the latter.

    Args:
        out: folder.
        config: the recipe.
        start: weights (.pt, .pth) of the same network, such as torchvision's of COCO; layers of
            another number of classes begin anew.
        seed: of the pictures and of what is not in `start`.
        device: cpu or cuda.
        workers: processes that make pictures.
        report: called with each step and its loss.

    Raises:
        MissingExtraError: there is no torchvision that fits torch.
        DataError: `start` is of another network.
    """
    torch.manual_seed(seed)
    model = make_mask_rcnn(1 + len(CATEGORIES), config.size_px)
    if start is not None:
        load_matching(model, start)
    model.to(device).train()
    optimiser = torch.optim.SGD(
        model.parameters(), config.learning_rate, momentum=0.9, weight_decay=config.weight_decay
    )
    for step, batch in enumerate(_batches(config, seed, workers)):
        for group in optimiser.param_groups:
            group["lr"] = config.rate(step)
        report(step, _descend(model, optimiser, batch, device, config.clip))
    return write_segmenter(model.cpu(), out, config.size_px)


def write_segmenter(model: Any, out: Path, size_px: tuple[int, int]) -> Path:
    """segmenter.pt and segmenter.onnx of a trained model; returns the latter."""
    out.mkdir(parents=True, exist_ok=True)
    stored = {
        "categories": list(CATEGORIES),
        "size_px": list(size_px),
        "state_dict": model.state_dict(),
    }
    torch.save(stored, out / "segmenter.pt")
    export_onnx(model, out / "segmenter.onnx", size_px)
    return out / "segmenter.onnx"


def export_onnx(model: Any, path: Path, size_px: tuple[int, int]) -> None:
    """Write what `tracking.segmenters.onnx_detector` reads; images of any size go in."""
    import onnx

    model.eval()
    image = torch.rand(3, *size_px)
    torch.onnx.export(
        model,
        ([image],),
        str(path),
        opset_version=_EXPORT_OPSET,
        input_names=["image"],
        output_names=list(OUTPUTS),
        dynamic_axes={"image": {1: "height", 2: "width"}, **{name: {0: "n"} for name in OUTPUTS}},
        dynamo=False,
    )
    graph = onnx.load(str(path))
    onnx.helper.set_model_props(graph, {CATEGORIES_KEY: json.dumps(CATEGORIES)})
    onnx.save(graph, str(path))


def load_matching(model: Any, path: Path) -> None:
    """Take over all weights whose names and shapes are the model's.

    Raises:
        DataError: not a file of weights, or of another network.
    """
    try:
        stored = torch.load(path, map_location="cpu", weights_only=True)
    except (OSError, RuntimeError, ValueError, EOFError, UnpicklingError) as error:
        raise DataError(path, f"not weights ({error})", "Give a .pt or .pth of torch") from error
    stored = stored.get("state_dict", stored)
    own = model.state_dict()
    fitting = {
        name: value
        for name, value in stored.items()
        if name in own and own[name].shape == value.shape
    }
    if len(fitting) < 0.9 * len(own):
        raise DataError(
            path,
            f"only {len(fitting)} of {len(own)} layers fit",
            "Give weights of torchvision's maskrcnn_resnet50_fpn",
        )
    model.load_state_dict(fitting, strict=False)


def _batches(config: SegmenterTraining, seed: int, workers: int) -> Iterator[list[LabelledImage]]:
    """As many as there are steps, each of pictures of its own; `workers` make them ahead."""
    make = partial(_batch, seed, config.batch)
    if workers < 2:
        yield from map(make, range(config.steps))
        return
    with ProcessPoolExecutor(workers, get_context("spawn")) as pool:
        waiting = [pool.submit(make, step) for step in range(min(2 * workers, config.steps))]
        for step in range(config.steps):
            yield waiting.pop(0).result()
            if step + 2 * workers < config.steps:
                waiting.append(pool.submit(make, step + 2 * workers))


def _batch(seed: int, size: int, step: int) -> list[LabelledImage]:
    images: list[LabelledImage] = []
    number = 0
    while len(images) < size:
        image = draw_labelled_image(seed, 1000 * step + number)
        number += 1
        if len(image.labels):
            images.append(image)
    return images


def _descend(
    model: Any,
    optimiser: torch.optim.Optimizer,
    batch: list[LabelledImage],
    device: str,
    clip: float,
) -> float:
    images = [_tensor(image.rgb).to(device) for image in batch]
    targets = [_target(image, device) for image in batch]
    loss = sum(model(images, targets).values(), torch.zeros((), device=device))
    optimiser.zero_grad()
    loss.backward()
    torch.nn.utils.clip_grad_norm_(model.parameters(), clip)
    optimiser.step()
    return float(loss.detach())


def _tensor(rgb: np.ndarray) -> torch.Tensor:
    return torch.from_numpy(np.ascontiguousarray(rgb.transpose(2, 0, 1))).float() / 255.0


def _target(image: LabelledImage, device: str) -> dict[str, torch.Tensor]:
    """Boxes x0, y0, x1, y1 as torchvision takes them, the far edge outside the mask."""
    boxes = []
    for mask in image.masks:
        y, x = np.nonzero(mask)
        boxes.append([x.min(), y.min(), x.max() + 1, y.max() + 1])
    values = {
        "boxes": torch.tensor(np.array(boxes), dtype=torch.float32),
        "labels": torch.from_numpy(image.labels),
        "masks": torch.from_numpy(image.masks.astype(np.uint8)),
    }
    return {name: value.to(device) for name, value in values.items()}
