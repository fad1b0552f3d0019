"""docs/online-tracking.md: its five minutes with one's own recording go through as printed."""

import re
import shlex
import subprocess
from pathlib import Path

import pytest

from robust6dof.cli import main
from robust6dof.data.track_file import read_tracks

PAGE = (Path(__file__).parents[1] / "docs" / "online-tracking.md").read_text()
(SECTION,) = re.findall(r"\n## Your own object.*?\n(.*?)\n## ", PAGE, re.S)
LINES = [
    line.strip()
    for block in re.findall(r"```console\n(.*?)```", SECTION, re.S)
    for line in block.strip().splitlines()
]


def test_commands_run_one_after_the_other(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Only the recording is made shorter."""
    pytest.importorskip("rerun", reason="extra rerun is not installed")
    monkeypatch.chdir(tmp_path)
    for line in LINES:
        if line.startswith("robust6dof "):
            short = line.replace("--frames 60", "--frames 3")
            assert main([*shlex.split(short)[1:], "--debug"]) == 0
        else:
            subprocess.run(shlex.split(line), check=True)
    assert len(list(read_tracks(Path("out/track/track.jsonl")))) == 3
    assert Path("out/track/track.rrd").stat().st_size > 10_000


def test_it_shows_every_way_to_start() -> None:
    for option in ("--mask", "--box", "--click", "--start", "--segmenter mask-rcnn"):
        assert option in SECTION
