"""Mask R-CNN through ONNX Runtime on a graph with its operators; and what is said without it."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
import torch

from robust6dof.errors import DataError, InputError, MissingExtraError
from robust6dof.frames import RgbdFrame
from robust6dof.tracking.segmentation import Segmenter, segment_click
from robust6dof.tracking.segmenters.mask_rcnn import MaskRcnn

K = np.array([[300.0, 0.0, 80.0], [0.0, 300.0, 60.0], [0.0, 0.0, 1.0]])
LEFT, RIGHT = (10, 20, 50, 60), (100, 30, 130, 80)
PROPOSALS = np.array([LEFT, np.add(LEFT, 2), RIGHT, (60, 90, 90, 110)])
MUG, CAN = 6, 4


@pytest.fixture
def tiny():
    pytest.importorskip("onnxruntime", reason="extra segmenter is not installed")
    pytest.importorskip("onnx", reason="onnx, which builds the test's graph, is not installed")
    from tracking.tiny_mask_rcnn import write_tiny_mask_rcnn

    return write_tiny_mask_rcnn


def red_things(depth: float = 0.8) -> RgbdFrame:
    """A bright red rectangle at the left, a darker one at the right."""
    rgb = np.full((120, 160, 3), 90, np.uint8)
    for (x0, y0, x1, y1), level in ((LEFT, 250), (RIGHT, 190)):
        rgb[y0:y1, x0:x1] = (level, 0, 0)
    return RgbdFrame(rgb, np.full((120, 160), depth, np.float32), K)


def inside(box: tuple[int, int, int, int]) -> np.ndarray:
    mask = np.zeros((120, 160), bool)
    mask[box[1] : box[3], box[0] : box[2]] = True
    return mask


def test_masks_of_the_category_the_surest_first(tiny, tmp_path: Path) -> None:
    """Four proposals: a duplicate falls to NMS, one shows nothing red."""
    path = tiny(tmp_path / "two.onnx", PROPOSALS, [MUG, MUG, MUG, MUG])
    segmenter: Segmenter = MaskRcnn.from_file(path, "mug")
    found = segmenter.segment(red_things())
    assert len(found) == 2
    both = inside(LEFT) | inside(RIGHT)
    for segment in found:
        np.testing.assert_array_equal(segment.mask, both)
    detected = MaskRcnn.from_file(path, "mug").weights.detect(red_things().rgb)
    np.testing.assert_allclose(detected.scores[:2], [250 / 255, 190 / 255], atol=0.02)


def test_other_categories_are_left_out(tiny, tmp_path: Path) -> None:
    path = tiny(tmp_path / "mixed.onnx", PROPOSALS, [CAN, CAN, MUG, CAN])
    assert len(MaskRcnn.from_file(path, "mug").segment(red_things())) == 1
    assert MaskRcnn.from_file(path, "bowl").segment(red_things()) == []


def test_the_file_names_its_categories(tiny, tmp_path: Path) -> None:
    path = tiny(tmp_path / "own.onnx", PROPOSALS, [2, 2, 1, 1], ("spoon", "fork"))
    assert len(MaskRcnn.from_file(path, "fork").segment(red_things())) == 1
    with pytest.raises(InputError, match="it knows: spoon, fork"):
        MaskRcnn.from_file(path, "mug")


def test_a_network_of_fixed_size_gives_masks_of_the_frame(tiny, tmp_path: Path) -> None:
    path = tiny(tmp_path / "half.onnx", PROPOSALS / 2, [MUG] * 4, size=(60, 80))
    mask = MaskRcnn.from_file(path, "mug").segment(red_things())[0].mask
    assert mask.shape == (120, 160)
    expected = inside(LEFT) | inside(RIGHT)
    assert (mask & expected).sum() / (mask | expected).sum() > 0.95


def test_outputs_of_other_names_are_taken_in_order(tiny, tmp_path: Path) -> None:
    names = ("2771", "2772", "2773", "2774")
    path = tiny(tmp_path / "numbers.onnx", PROPOSALS, [MUG] * 4, outputs=names)
    assert len(MaskRcnn.from_file(path, "mug").segment(red_things())) == 2


def test_a_click_takes_the_detection_under_it(tiny, tmp_path: Path) -> None:
    path = tiny(tmp_path / "click.onnx", PROPOSALS, [MUG] * 4)
    mask = segment_click(red_things(), 20, 30, MaskRcnn.from_file(path, "mug")).mask
    assert mask[30, 20]


def test_nothing_without_colour_or_depth(tiny, tmp_path: Path) -> None:
    segmenter = MaskRcnn.from_file(tiny(tmp_path / "t.onnx", PROPOSALS, [MUG] * 4), "mug")
    frame = red_things()
    assert segmenter.segment(red_things(depth=0.0)) == []
    grey = RgbdFrame(np.zeros_like(frame.rgb), frame.depth, K, has_color=False)
    assert segmenter.segment(grey) == []
    black = RgbdFrame(np.zeros_like(frame.rgb), frame.depth, K)
    assert segmenter.segment(black) == []


def test_unusable_weights_are_named(tmp_path: Path) -> None:
    pytest.importorskip("onnxruntime", reason="extra segmenter is not installed")
    with pytest.raises(DataError, match="missing"):
        MaskRcnn.from_file(tmp_path / "none.onnx", "mug")
    (tmp_path / "torn.onnx").write_bytes(b"not a graph")
    with pytest.raises(DataError, match="cannot open it"):
        MaskRcnn.from_file(tmp_path / "torn.onnx", "mug")
    (tmp_path / "weights.h5").write_bytes(b"")
    with pytest.raises(DataError, match=r"end in \.onnx or \.pt"):
        MaskRcnn.from_file(tmp_path / "weights.h5", "mug")


def test_without_onnxruntime_the_extra_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "w.onnx").write_bytes(b"")
    monkeypatch.setitem(sys.modules, "onnxruntime", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'robust6dof\[segmenter\]'"):
        MaskRcnn.from_file(tmp_path / "w.onnx", "mug")


def test_without_a_fitting_torchvision_the_extra_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    torch.save({"categories": ["mug"], "state_dict": {}}, tmp_path / "w.pt")
    monkeypatch.setitem(sys.modules, "torchvision", None)
    with pytest.raises(MissingExtraError, match=r"torchvision .*robust6dof\[segmenter-training\]"):
        MaskRcnn.from_file(tmp_path / "w.pt", "mug")
