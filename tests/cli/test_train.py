"""`robust6dof train` on recordings, as a stranger calls it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from robust6dof.cli import main
from robust6dof.cli.train import Options
from robust6dof.training.recipe import recipe_named
from training.rendered_recordings import write_recordings

FEW = ["--preset", "tiny", "--steps", "2", "--batch", "2", "--epoch", "4", "--held-out", "2"]
FEW += ["--workers", "0"]


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_recordings(tmp_path_factory.mktemp("recordings"))


def test_recordings_are_trained_on(
    root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = ["--data", "recordings", "--from", str(root)]
    assert main(["train", *source, *FEW, "--out", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    assert "4 recordings of can, mug" in printed
    assert (tmp_path / "network.safetensors").is_file()
    data = json.loads((tmp_path / "config.json").read_text())["data"]
    assert (data["data"], data["from"]) == ("recordings", str(root.resolve()))
    rows = [json.loads(line) for line in (tmp_path / "log.jsonl").read_text().splitlines()]
    assert "validation/anchor_5deg5cm" in rows[-1]


def test_the_paper_is_the_default() -> None:
    options = Options(out=Path("run"))
    recipe = recipe_named(options.recipe)
    assert (recipe.learning_rate, recipe.batch, recipe.steps) == (1e-3, 32, 50_000)
    assert (recipe.schedule, recipe.clip, recipe.ema) == ("constant", 0.0, 0.0)


def test_a_run_is_not_gone_on_with_on_other_recordings(
    root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = ["train", "--data", "recordings", "--from", str(root), *FEW, "--out", str(tmp_path)]
    assert main(source) == 0
    assert main([*source, "--categories", "mug"]) == 1
    assert "its data differ" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["--data", "recordings"], "needs its folder as --from"),
        (["--data", "nocs", "--from", "ROOT"], "this is recordings, not nocs"),
        (["--from", "ROOT"], "--from goes with --data recordings"),
        (["--data", "recordings", "--from", "ROOT/nowhere"], "no such folder"),
        (["--data", "recordings", "--from", "ROOT", "--categories", "bowl"], "none of: bowl"),
        (["--data", "recordings", "--from", "ROOT/mug_0"], "--held-out 0"),
        (["--replay", "ROOT"], "no run is stored"),
    ],
)
def test_a_wrong_call_says_what_to_do(
    root: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    options: list[str],
    said: str,
) -> None:
    given = [option.replace("ROOT", str(root)) for option in options]
    assert main(["train", *given, *FEW, "--out", str(tmp_path)]) == 1
    assert said in capsys.readouterr().err


def test_errors_of_stored_tracks_are_replayed(
    root: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    run = str(tmp_path / "run")
    assert (
        main(["predict", str(root), "--tracker", "static", "--protocol", "ycbv-auc", "--out", run])
        == 0
    )
    source = ["--data", "recordings", "--from", str(root), "--replay", run]
    assert main(["train", *source, *FEW, "--out", str(tmp_path / "out")]) == 0
    assert "errors to replay: 10 of can, 10 of mug" in capsys.readouterr().out
