"""The ICP follows two mugs through a real hand-held recording (depth alone)."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest

from shared_data import shared_data

BENCHMARK = Path(__file__).resolve().parents[2] / "benchmarks" / "track_seven_scenes.py"


def benchmark():
    spec = importlib.util.spec_from_file_location("track_seven_scenes", BENCHMARK)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


@pytest.mark.slow
@pytest.mark.parametrize("mug", ["A", "B"])
@pytest.mark.parametrize("start", ["pose", "box"])
def test_follows_a_mug_within_the_references_uncertainty(mug: str, start: str) -> None:
    run = benchmark().track_mug(shared_data("seven_scenes_mugs"), mug, "icp", start)
    assert all(track.state == "tracking" for track in run.tracks)
    assert np.median(run.translation_cm) < 3.0
    assert np.median(run.rotation_deg) < (5.0 if start == "pose" else 12.0)
    assert np.median(run.axis_deg) < 5.0
