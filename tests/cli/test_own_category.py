"""A category that is not among the six goes the whole way, by the commands of docs/shapes.md."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from robust6dof.cli import main
from robust6dof.data.track_file import read_tracks
from robust6dof.shapes.priors import PRIORS_VARIABLE, load_prior

TEAPOTS = 2


def write_teapots(folder: Path) -> None:
    """Round bodies with a spout towards +x and a knob: y up, metres."""
    folder.mkdir(parents=True)
    for number in range(TEAPOTS):
        body = trimesh.creation.icosphere(subdivisions=2, radius=0.06 + 0.01 * number)
        body.apply_scale([1.0, 0.8, 1.0])
        spout = trimesh.creation.cylinder(0.012, 0.1, sections=16)
        spout.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 3, [0, 1, 0]))
        spout.apply_translation([0.07, 0.02, 0.0])
        knob = trimesh.creation.icosphere(subdivisions=1, radius=0.015)
        knob.apply_translation([0.0, 0.055, 0.0])
        trimesh.util.concatenate([body, spout, knob]).export(folder / f"teapot_{number}.ply")


@pytest.mark.slow
@pytest.mark.timeout(900)
def test_from_meshes_to_a_tracked_object(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    meshes, priors = str(tmp_path / "meshes"), tmp_path / "priors"
    write_teapots(tmp_path / "meshes" / "teapot")
    monkeypatch.setenv(PRIORS_VARIABLE, str(priors))
    prior = str(priors / "teapot.npy")
    assert main(["priors", "--category", "teapot", "--meshes", meshes, "--out", prior]) == 0
    assert load_prior("teapot").shape == (2048, 3)

    own = ["--meshes", meshes, "--categories", "teapot"]
    data = str(tmp_path / "data")
    size = ["--sequences", "1", "--frames", "3", "--difficulty", "calm"]
    assert main(["synthesize", "aerial", "--out", data, *own, *size]) == 0

    run = tmp_path / "run"
    few = ["--steps", "2", "--batch", "2", "--epoch", "4", "--held-out", "2", "--workers", "0"]
    assert main(["train", "--preset", "tiny", "--out", str(run), *own, *few]) == 0

    (video,) = (tmp_path / "data").iterdir()
    out, mask = tmp_path / "track", str(video / "masks" / "000000.png")
    start = ["--category", "teapot", "--mask", mask, "--last", "1", "--no-video"]
    network = ["--tracker", "keypoints", "--weights", str(run / "network.safetensors")]
    assert main(["track", str(video), "--out", str(out), *start, *network]) == 0
    rows = list(read_tracks(out / "track.jsonl"))
    assert [row.track.category for row in rows] == ["teapot"] * 2
