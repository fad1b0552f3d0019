"""Starts are compared with the truth, whole: symmetry, refusals, who can be meant."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import binomtest

from evaluation.small_recordings import EXTENTS, write_recording
from robust6dof.baselines.static import StaticTracker
from robust6dof.cli import main
from robust6dof.data.dataset import ObjectTruth
from robust6dof.data.truth_file import open_with_truth
from robust6dof.errors import InputError
from robust6dof.evaluation.start_accuracy import (
    StartCase,
    StartTrial,
    choose_cases,
    summarize,
    try_start,
    wilson_interval,
)
from robust6dof.evaluation.start_noise import perturb
from robust6dof.frames import RgbdFrame
from robust6dof.geometry.transforms import make_transform, rotation_about_y

K = np.array([[300.0, 0, 160], [0, 300, 120], [0, 0, 1]])
FRAME = RgbdFrame(np.zeros((240, 320, 3), np.uint8), np.full((240, 320), 0.8, np.float32), K)
AT = make_transform(np.diag([1.0, -1.0, -1.0]), np.array([0.05, 0.02, 0.8]))


class Answers(StaticTracker):
    """Says what it was told to say, and remembers what it was asked."""

    def __init__(self, T_cam_obj: np.ndarray) -> None:
        super().__init__("mug")
        self.answer = T_cam_obj
        self.asked: dict = {}

    def start(self, frame, **hints):
        self.asked = hints
        return super().start(frame, T_cam_obj=self.answer, extents=EXTENTS)


def case(category: str = "mug", **fields) -> StartCase:
    return StartCase("s", FRAME, ObjectTruth("it", category, AT, EXTENTS, **fields))


def trial(one: StartCase, hint: str, tracker: StaticTracker, seed: int = 0) -> StartTrial:
    return try_start(one, hint, tracker, np.random.default_rng(seed))[0]


def test_the_pose_hint_carries_the_protocols_noise_and_nothing_else() -> None:
    found = trial(case(), "pose", StaticTracker("mug"), seed=4)
    noisy, _ = perturb(AT, EXTENTS, np.random.default_rng(4))
    assert found.translation_cm == pytest.approx(100 * np.linalg.norm(noisy[:3, 3] - AT[:3, 3]))
    assert found.rotation_deg > 0.1


@pytest.mark.parametrize(
    ("category", "handle", "expected"), [("mug", True, 90), ("mug", False, 0), ("can", True, 0)]
)
def test_a_turn_about_y_counts_where_it_shows(category: str, handle: bool, expected: float) -> None:
    turned = AT.copy()
    turned[:3, :3] = AT[:3, :3] @ rotation_about_y(np.pi / 2)
    found = trial(case(category, handle_visible=handle), "category", Answers(turned))
    assert found.rotation_deg == pytest.approx(expected, abs=1e-4)
    assert found.translation_cm == pytest.approx(0.0, abs=1e-9)
    assert found.scale_ratio == pytest.approx(1.0)


def test_only_the_hint_reaches_the_tracker() -> None:
    mask = np.zeros((240, 320), bool)
    mask[100:140, 150:200] = True
    for hint, keys in (("mask", {"mask"}), ("box", {"box"}), ("category", set())):
        tracker = Answers(AT)
        trial(case(mask=mask), hint, tracker)
        assert set(tracker.asked) == keys
    box = Answers(AT)
    trial(case(mask=mask), "box", box)
    asked = box.asked["box"]
    assert (asked.x, asked.y, asked.width, asked.height) == (150, 100, 49, 39)


def test_a_refusal_is_a_miss_that_says_why() -> None:
    nothing = replace(case(), frame=replace(FRAME, depth=np.zeros((240, 320), np.float32)))
    found, track = try_start(nothing, "box", StaticTracker("mug"), np.random.default_rng(0))
    assert track is None
    assert not found.is_within("20°10cm")
    assert "no valid depth" in found.problem


def test_a_hint_that_the_data_lacks_is_refused() -> None:
    with pytest.raises(InputError, match="no mask of it"):
        trial(case(), "mask", StaticTracker("mug"))


def test_the_category_alone_may_mean_any_of_its_kind() -> None:
    elsewhere = AT.copy()
    elsewhere[0, 3] -= 0.3
    other = ObjectTruth("other", "mug", elsewhere, EXTENTS)
    both = replace(case(), alike=(other,))
    assert trial(both, "category", Answers(elsewhere)).translation_cm == pytest.approx(0.0)
    assert trial(both, "box", Answers(elsewhere)).translation_cm == pytest.approx(30.0)
    turned = elsewhere.copy()
    turned[:3, :3] = elsewhere[:3, :3] @ rotation_about_y(np.pi / 2)
    hides = replace(both, alike=(replace(other, handle_visible=False),))
    assert trial(hides, "category", Answers(turned)).rotation_deg == pytest.approx(0.0, abs=1e-4)


def test_shares_are_counted_over_all_starts() -> None:
    rows = [
        StartTrial(f"s{i % 3}", str(i), "it", kind, "box", 3.0 * i, 0.4 * i, 1.0, 0.9, 0.1)
        for i, kind in enumerate(["mug", "can"] * 6)
    ]
    rows.append(StartTrial("s0", "x", "it", "mug", "box", np.inf, np.inf, np.nan, 0.0, 0.1, "no"))
    summary = {row.category: row for row in summarize(rows)}
    assert set(summary) == {"mug", "can", "all"}
    naive = 100 * np.mean([t.rotation_deg < 10 and t.translation_cm < 5 for t in rows])
    assert summary["all"].share["10°5cm"] == pytest.approx(naive)
    low, high = summary["all"].interval["10°5cm"]
    assert low <= naive <= high
    assert (summary["mug"].starts, summary["mug"].recordings) == (7, 3)


@pytest.mark.parametrize("hits", [0, 2, 7, 20])
def test_intervals_are_wilsons(hits: int) -> None:
    expected = binomtest(hits, 20).proportion_ci(method="wilson")
    ours = wilson_interval(100 * hits / 20, 20)
    np.testing.assert_allclose(ours, (100 * expected.low, 100 * expected.high), atol=1e-4)


def test_frames_are_spread_over_those_that_show_the_object(tmp_path: Path) -> None:
    write_recording(tmp_path / "r", frames=7, hidden={("mug_0", 0), ("mug_0", 6)})
    (sequence,) = open_with_truth(tmp_path / "r").sequences
    chosen = [c.frame.name for c in choose_cases(sequence, 3) if c.truth.name == "mug_0"]
    assert chosen == ["000001", "000003", "000005"]


def test_the_command_goes_on_where_it_stopped(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_recording(tmp_path / "r", frames=3)
    command = ["bench", "start", str(tmp_path / "r"), "--out", str(tmp_path / "out")]
    command += ["--tracker", "static", "--frames", "2", "--debug"]
    assert main([*command, "--hints", "pose"]) == 0
    first = (tmp_path / "out" / "trials.jsonl").read_text()
    assert main([*command, "--hints", "pose", "category"]) == 0
    both = (tmp_path / "out" / "trials.jsonl").read_text()
    assert both.startswith(first)
    assert len(both.splitlines()) == 2 * 2 * 2
    assert "| pose | mug | 2 |" in capsys.readouterr().out
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert {row["hint"] for row in summary} == {"pose", "category"}
    pictures = list((tmp_path / "out" / "misses").iterdir())
    assert len(pictures) == 4, "nothing stands on the flat wall that these recordings show"
