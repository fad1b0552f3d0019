"""The YCB objects' hand-made stand-ins, their sizes, and the one change of frame."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import KDTree

from robust6dof.cli import main
from robust6dof.errors import DataError
from robust6dof.frames import YCB_OBJECTS
from robust6dof.shapes.priors import chamfer, load_prior
from robust6dof.shapes.ycb_objects import (
    R_YCBV_OBJ,
    YCB_SIDES_M,
    known_extents,
    load_ycb_scan,
    make_ycb_stand_in,
)
from shared_data import shared_data


def test_every_object_has_a_size_and_nothing_else_has() -> None:
    assert tuple(YCB_SIDES_M) == YCB_OBJECTS
    assert known_extents("mug") is None


@pytest.mark.parametrize("name", YCB_OBJECTS)
def test_shipped_prior_is_the_stand_ins_surface(name: str) -> None:
    points, made = load_prior(name), make_ycb_stand_in(name)
    assert np.linalg.norm(np.ptp(points, axis=0)) == pytest.approx(1.0, abs=1e-5)
    sides = np.array(YCB_SIDES_M[name])
    np.testing.assert_allclose(made.extents, sides, atol=1e-9)
    # Evenly spread samples just miss corners.
    np.testing.assert_allclose(np.ptp(points, axis=0) * made.scale, sides, rtol=0.02, atol=0.002)


def test_priors_of_two_objects_differ() -> None:
    clouds = [load_prior(name)[::8] for name in YCB_OBJECTS]
    for i, a in enumerate(clouds):
        for b in clouds[:i]:
            assert chamfer(a.astype(float), b.astype(float)) > 0.013


def test_the_command_builds_the_shipped_prior(tmp_path: Path) -> None:
    out = tmp_path / "prior.npy"
    assert main(["priors", "--category", "040_large_marker", "--out", str(out)]) == 0
    np.testing.assert_allclose(np.load(out), load_prior("040_large_marker"), atol=1e-6)


@pytest.mark.parametrize("name", YCB_OBJECTS)
def test_scan_in_the_object_frame_is_the_official_model_turned_upright(name: str) -> None:
    """The official points, in YCB-Video's frame, lie on the scan's vertices."""
    scan = load_ycb_scan(shared_data("ycb_meshes"), name)
    official = np.loadtxt(shared_data("ycb_video_poses") / "models_points" / f"{name}.xyz")
    official = official - (official.min(axis=0) + official.max(axis=0)) / 2
    # From the few official points to the many of the scan; a pitcher's triangles are 5 mm wide.
    assert KDTree(scan.mesh.vertices).query(official @ R_YCBV_OBJ)[0].mean() < 0.0025
    np.testing.assert_allclose(scan.extents, YCB_SIDES_M[name], atol=0.0015)


def test_scans_turn_is_the_measured_one() -> None:
    path = shared_data("ycb_video_poses") / "ycbv_to_google16k_frame.json"
    measured = np.array(json.loads(path.read_text())["036_wood_block"]["R_ycbv_to_google16k"])
    assert np.degrees(np.arctan2(measured[1, 0], measured[0, 0])) == pytest.approx(12.162, abs=1e-2)


@pytest.mark.parametrize("name", ["011_banana", "035_power_drill", "025_mug"])
def test_stand_in_resembles_the_scan_in_no_other_turn(name: str) -> None:
    scan = load_ycb_scan(shared_data("ycb_meshes"), name).mesh.vertices[::8]
    points = make_ycb_stand_in(name).scale * load_prior(name).astype(float)
    halves = [np.diag(signs) for signs in ([1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1])]
    distances = [chamfer(points @ turn, scan) for turn in halves]
    assert np.argmin(distances) == 0
    assert distances[0] < 0.006


def test_missing_scan_says_what_to_do(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no scan of this object"):
        load_ycb_scan(tmp_path, "011_banana")
