"""The README's Python blocks and commands run as they stand, on a small recording."""

import re
import shlex
from pathlib import Path

import pytest

from robust6dof.cli import main
from robust6dof.synthetic.aerial import synthesize
from robust6dof.synthetic.plans import plan_aerial

README = (Path(__file__).parents[1] / "README.md").read_text()
PYTHON = re.findall(r"```python\n(.*?)```", README, re.S)
COMMANDS = [
    line
    for block in re.findall(r"```console\n(.*?)```", README, re.S)
    for line in block.splitlines()
    if line.startswith("robust6dof ")
]


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four frames of a mug, in the layout that the README describes."""
    plans = plan_aerial(7, 1, frames=4, difficulties=("calm",), categories=("mug",))
    return synthesize(plans[0], tmp_path_factory.mktemp("readme"))


def test_the_readme_shows_tracking_and_guidance() -> None:
    assert len(PYTHON) == 2
    assert {line.split()[1] for line in COMMANDS} >= {"track", "guide"}


@pytest.mark.parametrize("block", PYTHON, ids=["tracker", "servo"])
def test_python_blocks_run(block: str, recording: Path, capsys: pytest.CaptureFixture[str]) -> None:
    exec(compile(block.replace("path/to/video", str(recording)), "README.md", "exec"), {})
    assert capsys.readouterr().out


@pytest.mark.parametrize("line", COMMANDS)
def test_commands_run(line: str, recording: Path, tmp_path: Path) -> None:
    """Paths stand for the reader's own; twenty flights are cut to a second of one."""
    masks = sorted((recording / "masks").iterdir())
    line = line.replace("VIDEO", str(recording)).replace("FOLDER", str(recording))
    line = line.replace("first_mask.png", str(masks[0])).replace("out/", f"{tmp_path}/")
    arguments = shlex.split(line.replace("--seeds 0..19", "--seeds 0 --time-limit 1 --no-video"))
    assert main([*arguments[1:], "--debug"]) == 0
    assert list(tmp_path.rglob("*"))
