"""Every command answers --help without importing anything heavy, and fails with one line."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from robust6dof.cli import COMMANDS, main

HEAVY = {"torch", "cv2", "numba", "scipy", "matplotlib", "mujoco", "trimesh", "av", "small_gicp"}


@pytest.mark.parametrize("name", COMMANDS)
def test_help_imports_nothing_heavy(name: str) -> None:
    script = (
        "import sys\nfrom robust6dof.cli import main\n"
        "try:\n    main(sys.argv[1:])\nexcept SystemExit as stop:\n    assert stop.code == 0\n"
        f"print('heavy:', sorted({HEAVY!r} & set(sys.modules)))"
    )
    done = subprocess.run(
        [sys.executable, "-c", script, name, "--help"], capture_output=True, text=True, check=True
    )
    assert done.stdout.splitlines()[-1] == "heavy: []"
    for option in ("--seed", "--device", "--debug"):
        assert option in done.stdout


def test_an_unknown_command_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["fly"]) == 2
    assert "no command 'fly'" in capsys.readouterr().err


def test_version(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--version"]) == 0
    assert capsys.readouterr().out.startswith("robust6dof ")


def test_a_users_mistake_is_one_line_without_traceback(tmp_path: Path) -> None:
    missing = tmp_path / "nothing"
    done = subprocess.run(
        [sys.executable, "-m", "robust6dof", "track", str(missing), "--category", "mug"]
        + ["--out", str(tmp_path / "out")],
        capture_output=True,
        text=True,
    )
    assert done.returncode == 1
    assert len(done.stderr.strip().splitlines()) == 1
    assert str(missing) in done.stderr


@pytest.mark.parametrize("arguments", [["--help"], ["doctor", "--help"], ["doctor", "."]])
@pytest.mark.parametrize("unbuffered", ["", "1"])
def test_a_reader_that_has_gone_ends_a_command_quietly(
    arguments: list[str], unbuffered: str, tmp_path: Path
) -> None:
    reading, writing = os.pipe()
    os.close(reading)
    environment = {**os.environ, "PYTHONUNBUFFERED": unbuffered}
    command = [sys.executable, "-m", "robust6dof", *arguments]
    done = subprocess.run(
        command, stdout=writing, stderr=subprocess.PIPE, env=environment, cwd=tmp_path
    )
    os.close(writing)
    assert done.returncode == 141
    assert b"Broken" not in done.stderr
