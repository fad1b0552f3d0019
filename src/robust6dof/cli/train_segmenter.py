"""Fine-tune Mask R-CNN on the synthetic world and export it to ONNX, for --segmenter mask-rcnn.

Needs a torchvision that fits torch (extra segmenter-training), and a GPU for any use.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from robust6dof.cli.options import CommonOptions


@dataclass(frozen=True, kw_only=True)
class Options(CommonOptions):
    out: Path
    """Folder for segmenter.pt and segmenter.onnx."""
    start: Path | None = None
    """Weights to go on from (.pt, .pth): torchvision's maskrcnn_resnet50_fpn, of COCO say, or a
    segmenter.pt; without them everything is learnt anew."""
    steps: int = 20_000
    """Steps of the optimiser."""
    batch: int = 8
    """Pictures in each step."""
    learning_rate: float = 0.01
    """Of SGD."""
    size: tuple[int, int] = (480, 640)
    """Shorter and longer side that pictures are scaled to [px]."""
    workers: int = 1
    """Processes that make the pictures."""


def run(options: Options) -> None:
    """Train, export.

    Raises:
        MissingExtraError: no torchvision that fits torch.
        DataError: unusable weights to start from.
    """
    from tqdm import tqdm

    from robust6dof.network.device import resolve_device
    from robust6dof.tracking.segmenters.torchvision_detector import import_torchvision
    from robust6dof.training.segmenter import SegmenterTraining, train_segmenter

    import_torchvision()
    config = SegmenterTraining(
        steps=options.steps,
        batch=options.batch,
        learning_rate=options.learning_rate,
        size_px=options.size,
    )
    with tqdm(total=options.steps, unit="step", mininterval=1.0) as bar:

        def report(step: int, loss: float) -> None:
            bar.update()
            bar.set_postfix(loss=f"{loss:.3f}")

        path = train_segmenter(
            options.out,
            config,
            start=options.start,
            seed=options.seed,
            device=resolve_device(options.device),
            workers=options.workers,
            report=report,
        )
    print(f"use it with: robust6dof track … --segmenter mask-rcnn --segmenter-weights {path}")
