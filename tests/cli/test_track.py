"""`robust6dof track` on a small recording: what it writes, and what it refuses."""

from __future__ import annotations

from pathlib import Path

import av
import cv2
import numpy as np
import pytest

from baselines.tabletop_scene import K, look_at_object, make_tabletop
from robust6dof.cli import main
from robust6dof.data import write_sequence
from robust6dof.data.track_file import read_ob_in_cam, read_tracks

FRAMES = 6


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A can on a table; the first frame's pose and mask beside it."""
    folder = tmp_path_factory.mktemp("recording")
    scene, rng = make_tabletop("can", 0), np.random.default_rng(0)
    views = [look_at_object(0.7 + 0.02 * index, 0.7, 0.7) for index in range(FRAMES)]
    shots = [scene.shoot(view, rng, index / 20) for index, view in enumerate(views)]
    write_sequence(folder / "video", [shot.frame for shot in shots])
    np.savetxt(folder / "start.txt", shots[0].T_cam_obj)
    cv2.imwrite(str(folder / "mask.png"), shots[0].mask.astype(np.uint8) * 255)
    y, x = np.nonzero(shots[0].mask)
    (folder / "click.txt").write_text(f"{np.median(x):.0f},{np.median(y):.0f}")
    return folder


def track(recording: Path, out: Path, *options: str) -> int:
    return main(
        ["track", str(recording / "video"), "--category", "can", "--out", str(out), *options]
    )


@pytest.mark.parametrize("hint", [("--start", "start.txt"), ("--mask", "mask.png")])
def test_writes_poses_and_a_video(
    recording: Path, tmp_path: Path, hint: tuple[str, str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert track(recording, tmp_path, hint[0], str(recording / hint[1])) == 0
    rows = list(read_tracks(tmp_path / "track.jsonl"))
    assert len(rows) == FRAMES
    assert {row.track.category for row in rows} == {"can"}
    poses = read_ob_in_cam(tmp_path / "ob_in_cam")
    assert list(poses) == [row.frame for row in rows]
    np.testing.assert_allclose(poses[rows[-1].frame], rows[-1].track.T_cam_obj, atol=1e-6)
    with av.open(str(tmp_path / "overlay.mp4")) as video:
        assert sum(1 for _ in video.decode(video=0)) == FRAMES
    assert f"{FRAMES} frames: {FRAMES} tracking" in capsys.readouterr().out


def test_a_range_without_colour_or_video(recording: Path, tmp_path: Path) -> None:
    options = ["--first", "1", "--last", "5", "--every", "2", "--depth-only", "--no-video"]
    assert track(recording, tmp_path, *options, "--tracker", "static") == 0
    assert len(list(read_tracks(tmp_path / "track.jsonl"))) == 3
    assert not (tmp_path / "overlay.mp4").exists()


def test_starts_from_a_click_and_records_a_timeline(recording: Path, tmp_path: Path) -> None:
    chunk = pytest.importorskip("rerun.chunk", reason="extra rerun is not installed")
    path = tmp_path / "track.rrd"
    click = (recording / "click.txt").read_text()
    options = ["--click", click, "--tracker", "static", "--record", str(path), "--no-video"]
    assert track(recording, tmp_path, *options) == 0
    poses = read_ob_in_cam(tmp_path / "ob_in_cam")
    assert len(poses) == FRAMES
    true = np.loadtxt(recording / "start.txt")
    assert np.linalg.norm(poses["000000"][:3, 3] - true[:3, 3]) < 0.03
    steps = [part for part in chunk.RrdReader(path).stream() if part.entity_path == "/confidence"]
    assert sum(part.num_rows for part in steps) == FRAMES


def test_shows_it_live_until_interrupted(
    recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch
) -> None:
    """Every frame reaches the page, which stays until Ctrl-C and is taken down then."""
    pytest.importorskip("viser", reason="extra viewer is not installed")
    from urllib.request import urlopen

    from viser import ViserServer

    from robust6dof.visualization.live_view import LiveView

    served = []

    def visit_then_interrupt(server: ViserServer) -> None:
        with urlopen(f"http://127.0.0.1:{server.get_port()}", timeout=10) as page:
            served.append(page.status)
        raise KeyboardInterrupt

    shown, show = [], LiveView.show
    monkeypatch.setattr(ViserServer, "sleep_forever", visit_then_interrupt)
    monkeypatch.setattr(LiveView, "show", lambda page, view: (shown.append(view), show(page, view)))
    start = str(recording / "start.txt")
    options = ["--tracker", "static", "--start", start, "--view", "--view-port", "0"]
    assert track(recording, tmp_path, *options, "--no-video") == 0
    assert len(shown) == FRAMES
    assert served == [200]
    assert "open http://127.0.0.1:" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--click", "9,9,9"], "does not read --click x,y"),
        (["--click", "1,1", "--box", "1,2,3,4"], "give only one of --box and --click"),
        (["--segmenter", "mask-rcnn"], "needs --segmenter-weights FILE.onnx"),
        (["--segmenter-weights", "w.onnx"], "goes with --segmenter mask-rcnn"),
        (["--segmenter", "mask-rcnn", "--segmenter-weights", "no.onnx"], "weights are missing"),
        (["--tracker", "psychic"], "no tracker 'psychic'"),
        (["--box", "1,2,3"], "does not read --box x,y,width,height"),
        (["--box", "1,2,3,4", "--mask", "m.png"], "give only one of --mask and --box"),
        (["--first", "99"], "no frames from --first 99"),
        (["--every", "0"], "--every counts from 1"),
    ],
)
def test_a_mistake_is_one_line(
    recording: Path,
    tmp_path: Path,
    options: list[str],
    message: str,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert track(recording, tmp_path, *options) == 1
    error = capsys.readouterr().err
    assert message in error
    assert "Traceback" not in error


def test_an_interruption_keeps_what_was_done(
    recording: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from robust6dof.baselines.static import StaticTracker

    step, calls = StaticTracker.step, []

    def interrupted(self, track, frame):
        calls.append(frame.name)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return step(self, track, frame)

    monkeypatch.setattr(StaticTracker, "step", interrupted)
    start = str(recording / "start.txt")
    assert track(recording, tmp_path, "--tracker", "static", "--start", start) == 130
    assert len(list(read_tracks(tmp_path / "track.jsonl"))) == 3
    with av.open(str(tmp_path / "overlay.mp4")) as video:
        assert sum(1 for _ in video.decode(video=0)) == 3


def test_the_recordings_intrinsics_are_those_of_the_scene(recording: Path) -> None:
    np.testing.assert_allclose(np.loadtxt(recording / "video" / "cam_K.txt"), K)


def test_a_ycb_object_instead_of_a_category(
    recording: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    video, start = str(recording / "video"), str(recording / "start.txt")
    command = ["track", video, "--out", str(tmp_path), "--start", start, "--no-video"]
    given = ["--tracker", "static", "--object"]
    assert main([*command, *given, "005_tomato_soup_can"]) == 0
    rows = list(read_tracks(tmp_path / "track.jsonl"))
    assert {row.track.category for row in rows} == {"005_tomato_soup_can"}
    assert main([*command, *given, "005_soup"]) == 1
    assert "061_foam_brick" in capsys.readouterr().err
    assert main([*command, *given, "005_tomato_soup_can", "--category", "can"]) == 1
