"""Whose weights are taken: a category's, a YCB object's, one's own, and never another's."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from robust6dof.errors import DataError, InputError
from robust6dof.frames import YCB_OBJECTS, RgbdFrame
from robust6dof.network.checkpoint import save_network
from robust6dof.network.config import preset
from robust6dof.network.robust6dof_net import Robust6DofNet
from robust6dof.shapes.ycb_objects import YCB_SIDES_M
from robust6dof.tracking import pretrained
from robust6dof.tracking.initialisation import find_initial_pose
from robust6dof.tracking.pretrained import category_or_object, load_pretrained, shipped_weights
from robust6dof.tracking.tracker import Tracker

MUSTARD = "006_mustard_bottle"


def test_one_name_of_two() -> None:
    assert category_or_object("mug", None) == "mug"
    assert category_or_object("", MUSTARD) == MUSTARD
    for names in ((None, None), ("", ""), ("mug", MUSTARD)):
        with pytest.raises(InputError):
            category_or_object(*names)


def test_unknown_object_lists_what_there_is() -> None:
    with pytest.raises(InputError, match="061_foam_brick"):
        Tracker.from_pretrained(object="006_ketchup")
    with pytest.raises(InputError, match="061_foam_brick"):
        Tracker.from_pretrained(category="006_ketchup")


def test_objects_never_fall_back_to_the_weights_of_categories() -> None:
    of_objects = {shipped_weights(name) for name in YCB_OBJECTS}
    assert len(of_objects) == 1
    assert of_objects.isdisjoint({shipped_weights("mug"), None})


def test_a_build_without_weights_says_how_to_make_them(monkeypatch, tmp_path: Path) -> None:
    monkeypatch.setattr(pretrained, "files", lambda _package: tmp_path)
    with pytest.raises(DataError, match="ycb-video"):
        load_pretrained(category=MUSTARD)
    with pytest.raises(DataError, match="ships no weights"):
        load_pretrained(category="mug")


def test_all_weights_in_the_box_are_small() -> None:
    box = Path(str(shipped_weights("mug"))).parent
    assert sum(path.stat().st_size for path in box.iterdir()) < 20e6
    assert Tracker.from_pretrained(object=MUSTARD, device="cpu").category == MUSTARD


def test_own_weights_follow_an_object(tmp_path: Path) -> None:
    torch.manual_seed(0)
    save_network(Robust6DofNet(preset("tiny")), tmp_path / "network")
    tracker = Tracker.from_pretrained(tmp_path / "network.safetensors", object=MUSTARD)
    assert tracker.category == MUSTARD


def test_an_objects_size_is_known() -> None:
    K = np.array([[6.0, 0, 2.5], [0, 6.0, 1.5], [0, 0, 1]])
    frame = RgbdFrame(np.zeros((4, 6, 3), np.uint8), np.ones((4, 6), np.float32), K)
    initial = find_initial_pose(frame, MUSTARD, T_cam_obj=np.eye(4))
    np.testing.assert_allclose(initial.extents, YCB_SIDES_M[MUSTARD])
