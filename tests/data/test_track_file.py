"""Tracks written and read back; what a killed or resumed run leaves."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from data.recordings import make_T_cam_obj
from robust6dof.data.track_file import (
    TrackWriter,
    read_ob_in_cam,
    read_tracks,
    write_ob_in_cam,
)
from robust6dof.errors import DataError, InputError, Robust6dofWarning
from robust6dof.frames import Track, TrackState


def make_track(index: int = 0) -> Track:
    return Track(
        T_cam_obj=make_T_cam_obj(index),
        extents=np.array([0.12, 0.09, 0.08]),
        confidence=0.75,
        state=TrackState.UNCERTAIN,
        category="mug",
        object_name="mug_a",
        memory=object(),
    )


def test_round_trip(tmp_path: Path) -> None:
    path = tmp_path / "run" / "track.jsonl"
    with TrackWriter(path) as writer:
        for index in range(3):
            writer.write(f"f{index}", make_track(index), ms=12.5)
    rows = list(read_tracks(path))
    assert [row.frame for row in rows] == ["f0", "f1", "f2"]
    for index, row in enumerate(rows):
        expected = make_track(index)
        np.testing.assert_allclose(row.track.T_cam_obj, expected.T_cam_obj, atol=1e-15)
        np.testing.assert_array_equal(row.track.extents, expected.extents)
        assert (row.track.state, row.track.confidence) == (TrackState.UNCERTAIN, 0.75)
        assert (row.track.category, row.track.object_name, row.ms) == ("mug", "mug_a", 12.5)


def test_lines_have_the_documented_fields(tmp_path: Path) -> None:
    with TrackWriter(tmp_path / "track.jsonl") as writer:
        writer.write("000007", make_track(1), ms=8.0)
    fields = json.loads((tmp_path / "track.jsonl").read_text())
    assert set(fields) == {
        *("frame", "object", "category", "T_cam_obj"),
        *("extents_m", "confidence", "state", "ms"),
    }
    assert fields["T_cam_obj"][3:8:4] == [0.01, 0.02], "row-major"
    assert fields["state"] == "uncertain"


def test_each_line_is_on_disk_at_once(tmp_path: Path) -> None:
    path = tmp_path / "track.jsonl"
    writer = TrackWriter(path)
    writer.write("a", make_track(), ms=1.0)
    assert len(list(read_tracks(path))) == 1
    writer.close()


def test_an_interrupted_run_keeps_what_was_done(tmp_path: Path) -> None:
    path = tmp_path / "track.jsonl"
    script = (
        # A shell's background job is born with SIGINT ignored; Python then never interrupts.
        "import signal, sys, time; sys.path.insert(0, sys.argv[2])\n"
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "from data.test_track_file import TrackWriter, make_track\n"
        "with TrackWriter(sys.argv[1]) as writer:\n"
        "    writer.write('a', make_track(), 1.0)\n"
        "    print('ready', flush=True)\n"
        "    time.sleep(60)\n"
    )
    tests = str(Path(__file__).parents[1])
    with subprocess.Popen(
        [sys.executable, "-c", script, str(path), tests],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    ) as process:
        assert process.stdout is not None
        process.stdout.readline()
        os.kill(process.pid, signal.SIGINT)
        process.wait(timeout=30)
    assert [row.frame for row in read_tracks(path)] == ["a"]


def test_a_torn_last_line_is_left_out_and_overwritten_on_resume(tmp_path: Path) -> None:
    path = tmp_path / "track.jsonl"
    with TrackWriter(path) as writer:
        writer.write("a", make_track(), ms=1.0)
        writer.write("b", make_track(), ms=1.0)
    path.write_bytes(path.read_bytes()[:-30])
    with pytest.warns(Robust6dofWarning, match="torn"):
        assert [row.frame for row in read_tracks(path)] == ["a"]
    with TrackWriter(path, resume=True) as writer:
        writer.write("c", make_track(), ms=1.0)
    assert [row.frame for row in read_tracks(path)] == ["a", "c"]
    with TrackWriter(path):
        pass
    assert list(read_tracks(path)) == []


@pytest.mark.parametrize(
    "line",
    [
        "no json\n",
        "{}\n",
        "[]\n",
        json.dumps({"frame": "a", "T_cam_obj": [1.0] * 16, "extents_m": [1, 1, 1]}) + "\n",
    ],
)
def test_false_lines_are_named(tmp_path: Path, line: str) -> None:
    path = tmp_path / "track.jsonl"
    with TrackWriter(path) as writer:
        writer.write("a", make_track(), ms=1.0)
    path.write_text(path.read_text() + line)
    with pytest.raises(DataError, match="line 2 is not a track"):
        list(read_tracks(path))


def test_nan_is_not_written(tmp_path: Path) -> None:
    track = make_track()
    track.T_cam_obj[0, 3] = np.nan
    with (
        TrackWriter(tmp_path / "track.jsonl") as writer,
        pytest.raises(InputError, match="frame a contains NaN"),
    ):
        writer.write("a", track, ms=1.0)
    assert (tmp_path / "track.jsonl").read_text() == ""


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"track\.jsonl.*missing"):
        list(read_tracks(tmp_path / "track.jsonl"))


def test_ob_in_cam_round_trip(tmp_path: Path) -> None:
    for index in (10, 9):
        write_ob_in_cam(tmp_path / "ob_in_cam", str(index), make_T_cam_obj(index))
    stored = read_ob_in_cam(tmp_path / "ob_in_cam")
    assert list(stored) == ["9", "10"]
    np.testing.assert_allclose(stored["10"], make_T_cam_obj(10), atol=1e-8)
    with pytest.raises(DataError, match="no poses"):
        read_ob_in_cam(tmp_path)
