"""What Mask R-CNN is trained on; where torchvision loads, a step of training and the export."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from robust6dof.cli import main
from robust6dof.errors import DataError, MissingExtraError
from robust6dof.frames import CATEGORIES
from robust6dof.rendering.d435i import color_camera
from robust6dof.tracking.segmenters.mask_rcnn import MaskRcnn
from robust6dof.tracking.segmenters.torchvision_detector import import_torchvision
from robust6dof.training.segmenter import SegmenterTraining, load_matching, train_segmenter
from robust6dof.training.segmenter_images import LEAST_PIXELS, draw_labelled_image


def has_torchvision() -> bool:
    try:
        import_torchvision()
    except MissingExtraError:
        return False
    return True


needs_torchvision = pytest.mark.skipif(
    not has_torchvision(), reason="there is no torchvision that loads beside this torch"
)


def test_every_object_has_a_label_and_pixels_of_its_own() -> None:
    images = [draw_labelled_image(3, number) for number in range(3)]
    camera = color_camera(np.eye(4))
    for image in images:
        assert image.rgb.shape == (camera.height, camera.width, 3)
        assert image.masks.shape == (len(image.labels), camera.height, camera.width)
        assert image.masks.sum(axis=0).max(initial=0) <= 1, "a pixel shows one object"
        assert all(mask.sum() >= LEAST_PIXELS for mask in image.masks)
        assert set(image.labels) <= set(range(1, len(CATEGORIES) + 1))
    assert sum(len(image.labels) for image in images) > 3


def test_objects_differ_in_colour_from_what_is_about_them() -> None:
    """A mask on the wrong pixels would cut across objects: colours agree more inside than out."""
    image = draw_labelled_image(0, 2)
    (mask,) = image.masks
    rows, columns = np.nonzero(mask)
    shifted = np.roll(mask, (60, 60), axis=(0, 1))
    spread = [image.rgb[pixels].std(axis=0).mean() for pixels in (mask, shifted | mask)]
    assert rows.size == columns.size > 1000
    assert spread[0] < spread[1]


def test_the_same_numbers_draw_the_same_picture() -> None:
    first, again, other = (draw_labelled_image(*key) for key in ((5, 1), (5, 1), (5, 2)))
    np.testing.assert_array_equal(first.rgb, again.rgb)
    np.testing.assert_array_equal(first.masks, again.masks)
    assert not np.array_equal(first.rgb, other.rgb)


def test_the_rate_rises_and_falls() -> None:
    config = SegmenterTraining(steps=1000, warm_up=100, learning_rate=0.01)
    rates = [config.rate(step) for step in (0, 49, 100, 599, 600, 899, 900)]
    np.testing.assert_allclose(rates, [1e-4, 5e-3, 1e-2, 1e-2, 1e-3, 1e-3, 1e-4])


def test_weights_of_another_network_are_refused(tmp_path: Path) -> None:
    model = torch.nn.Sequential(*[torch.nn.Linear(3, 3) for _ in range(10)])
    torch.save({"0.weight": torch.zeros(3, 3), "1.weight": torch.zeros(9, 9)}, tmp_path / "w.pth")
    with pytest.raises(DataError, match="only 1 of 20 layers fit"):
        load_matching(model, tmp_path / "w.pth")
    (tmp_path / "torn.pth").write_bytes(b"x")
    with pytest.raises(DataError, match="not weights"):
        load_matching(model, tmp_path / "torn.pth")


@pytest.mark.skipif(has_torchvision(), reason="a torchvision that loads is here")
def test_the_command_names_the_extra(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["train-segmenter", "--out", str(tmp_path), "--steps", "1"]) == 1
    said = capsys.readouterr().err
    assert "torchvision that loads beside torch" in said
    assert "robust6dof[segmenter-training]" in said


@needs_torchvision
@pytest.mark.slow
def test_a_step_and_an_export_that_onnx_runtime_agrees_with(tmp_path: Path) -> None:
    pytest.importorskip("onnxruntime", reason="extra segmenter is not installed")
    config = SegmenterTraining(steps=1, batch=1, size_px=(96, 128))
    path = train_segmenter(tmp_path, config)
    exported = MaskRcnn.from_file(path, "mug").weights
    direct = MaskRcnn.from_file(path.with_suffix(".pt"), "mug").weights
    assert exported.categories == direct.categories == CATEGORIES
    image = draw_labelled_image(1, 0).rgb
    ours, theirs = exported.detect(image), direct.detect(image)
    np.testing.assert_array_equal(ours.labels, theirs.labels)
    np.testing.assert_allclose(ours.scores, theirs.scores, atol=1e-3)
