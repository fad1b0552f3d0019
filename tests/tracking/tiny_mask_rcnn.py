"""A hand-built ONNX graph with the inputs, outputs and special operators of Mask R-CNN.

It sees red things: fixed proposals are scored by RoiAlign on the redness of the image, thinned out
by NonMaxSuppression; a mask is the redness itself.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

INPUTS = ("image",)
OUTPUTS = ("boxes", "labels", "scores", "masks")


def write_tiny_mask_rcnn(
    path: Path,
    boxes: np.ndarray,
    labels: Sequence[int],
    categories: Sequence[str] | None = None,
    size: tuple[int | str, int | str] = ("height", "width"),
    outputs: Sequence[str] = OUTPUTS,
) -> Path:
    """Write it.

    Args:
        path: of the file.
        boxes: [P, 4] proposals x0, y0, x1, y1 [px].
        labels: class of each.
        categories: stored in the file; nothing is stored if not given.
        size: height and width of the image that it takes; names stand for any.
        outputs: names, in torchvision's order.
    """
    nodes = [*_redness(), *_proposals(), *_results(outputs)]
    float_, int_ = TensorProto.FLOAT, TensorProto.INT64
    kinds = [(float_, ["n", 4]), (int_, ["n"]), (float_, ["n"]), (float_, ["n", 1, *size])]
    graph = helper.make_graph(
        nodes,
        "red",
        [helper.make_tensor_value_info("image", float_, [3, *size])],
        [
            helper.make_tensor_value_info(name, kind, shape)
            for name, (kind, shape) in zip(outputs, kinds, strict=True)
        ],
        _constants(np.asarray(boxes, np.float32), np.asarray(labels, np.int64)),
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 16)], ir_version=9)
    if categories is not None:
        helper.set_model_props(model, {"robust6dof.categories": json.dumps(list(categories))})
    onnx.checker.check_model(model)
    onnx.save(model, str(path))
    return path


def _redness() -> list[onnx.NodeProto]:
    """red = clip(R − (G + B) / 2, 0, 1), as a feature map [1, 1, H, W]."""
    return [
        helper.make_node("Unsqueeze", ["image", "zero"], ["batch"]),
        helper.make_node("Conv", ["batch", "kernel"], ["contrast"]),
        helper.make_node("Clip", ["contrast", "low", "high"], ["red"]),
    ]


def _proposals() -> list[onnx.NodeProto]:
    """Mean redness of each proposal, then NMS over all: `index` [N] of those that stay."""
    return [
        helper.make_node(
            "RoiAlign",
            ["red", "proposals", "image_index"],
            ["pooled"],
            output_height=1,
            output_width=1,
            sampling_ratio=8,
            coordinate_transformation_mode="half_pixel",
        ),
        helper.make_node("Reshape", ["pooled", "row"], ["score_row"]),
        helper.make_node("Unsqueeze", ["proposals", "zero"], ["proposals_batch"]),
        helper.make_node(
            "NonMaxSuppression",
            ["proposals_batch", "score_row", "most", "iou", "least"],
            ["selected"],
        ),
        helper.make_node("Gather", ["selected", "two"], ["index"], axis=1),
        helper.make_node("Reshape", ["score_row", "flat"], ["all_scores"]),
    ]


def _results(outputs: Sequence[str]) -> list[onnx.NodeProto]:
    boxes, labels, scores, masks = outputs
    return [
        helper.make_node("Gather", ["proposals", "index"], [boxes]),
        helper.make_node("Gather", ["all_labels", "index"], [labels]),
        helper.make_node("Gather", ["all_scores", "index"], [scores]),
        helper.make_node("Shape", ["index"], ["count"]),
        helper.make_node("Concat", ["count", "ones"], ["repeats"], axis=0),
        helper.make_node("Tile", ["red", "repeats"], [masks]),
    ]


def _constants(boxes: np.ndarray, labels: np.ndarray) -> list[onnx.TensorProto]:
    values = {
        "kernel": np.array([1.0, -0.5, -0.5], np.float32).reshape(1, 3, 1, 1),
        "proposals": boxes,
        "all_labels": labels,
        "image_index": np.zeros(len(boxes), np.int64),
        "low": np.array(0.0, np.float32),
        "high": np.array(1.0, np.float32),
        "zero": np.array([0], np.int64),
        "two": np.array(2, np.int64),
        "row": np.array([1, 1, -1], np.int64),
        "flat": np.array([-1], np.int64),
        "ones": np.array([1, 1, 1], np.int64),
        "most": np.array([10], np.int64),
        "iou": np.array([0.5], np.float32),
        "least": np.array([0.0], np.float32),
    }
    return [numpy_helper.from_array(value, name) for name, value in values.items()]
