"""The timeline holds what was written, read back from the file."""

from __future__ import annotations

import sys
from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest

from robust6dof.errors import MissingExtraError
from robust6dof.visualization.rerun_recorder import RerunRecorder
from visualization.tracked_mug import FRAMES, mug_views


def read_back(path: Path) -> dict[str, list[dict]]:
    """Entity → its rows in order, each a dictionary of its components' first values."""
    chunk = pytest.importorskip("rerun.chunk", reason="extra rerun is not installed")
    is_temporal = pytest.importorskip("pyarrow").types.is_temporal
    rows: dict[str, list[dict]] = defaultdict(list)
    for part in chunk.RrdReader(path).stream():
        batch = part.to_record_batch()
        # Python's own times hold no nanoseconds, and no test asks for times.
        kept = [field.name for field in batch.schema if not is_temporal(field.type)]
        rows[part.entity_path] += batch.select(kept).to_pylist()
    return {
        entity: sorted(found, key=lambda row: row.get("frame") or 0)
        for entity, found in rows.items()
    }


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[dict]]:
    pytest.importorskip("rerun", reason="extra rerun is not installed")
    path = tmp_path_factory.mktemp("rerun") / "new" / "track.rrd"
    with RerunRecorder(path) as recorder:
        for view in mug_views():
            recorder.write(view)
    return read_back(path)


def column(rows: list[dict], name: str) -> list:
    (key,) = {key for row in rows for key in row if key.endswith(name)}
    return [row[key] for row in rows]


def test_confidence_and_state_over_time(recorded: dict[str, list[dict]]) -> None:
    views = mug_views()
    rows = recorded["/confidence"]
    assert [row["frame"] for row in rows] == list(range(FRAMES))
    values = np.array(column(rows, "Scalars:scalars")).ravel()
    np.testing.assert_allclose(values, [view.track.confidence for view in views])
    states = [row for row in recorded["/state"] if row.get("frame") is not None]
    assert column(states, "StateChange:state") == [[str(view.track.state)] for view in views]


def test_the_object_is_where_it_was_tracked(recorded: dict[str, list[dict]]) -> None:
    places = np.array(column(recorded["/world/object"], "Transform3D:translation")).reshape(-1, 3)
    tracked = [view.track.T_cam_obj[:3, 3] for view in mug_views()]
    np.testing.assert_allclose(places, tracked, atol=1e-6)
    halves = np.array(column(recorded["/world/object/box"], "Boxes3D:half_sizes")).reshape(-1, 3)
    np.testing.assert_allclose(halves, [v.track.extents / 2 for v in mug_views()], atol=1e-6)


def test_points_keypoints_and_matches_are_all_there(recorded: dict[str, list[dict]]) -> None:
    for entity, name, expected in (
        ("/world/cloud", "Points3D:positions", [len(v.cloud_cam) for v in mug_views()]),
        ("/world/keypoints", "Points3D:positions", [len(v.keypoints_cam) for v in mug_views()]),
        ("/camera/matches", "LineStrips2D:strips", [len(v.matches_px) for v in mug_views()]),
    ):
        assert [len(values) for values in column(recorded[entity], name)] == expected
    assert len(recorded["/camera/image"]) == FRAMES


def test_without_rerun_the_extra_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(MissingExtraError, match=r"pip install 'robust6dof\[rerun\]'"):
        RerunRecorder(tmp_path / "track.rrd")
