"""Files of the second loop: what stands in them and what is null."""

import json

import pytest

from evaluation.pose_records import record
from robust6dof.errors import InputError
from robust6dof.evaluation.protocols import PROTOCOLS, find_protocol
from robust6dof.evaluation.published import CAVEATS, PUBLISHED
from robust6dof.evaluation.report import markdown, write_report
from robust6dof.evaluation.scores import Scores, cumulative

TRACK_PROTOCOLS = ["aerial", "nocs-map", "6pack", "6pack-fixed", "captra", "wild6d"]


def scores_of(protocol, *records):
    from dataclasses import replace

    scores = PROTOCOLS[protocol].score(list(records))
    return replace(scores, tracker="mine", data="recordings")


@pytest.mark.parametrize("protocol", TRACK_PROTOCOLS)
def test_every_protocol_writes_its_files(protocol, tmp_path):
    scores = scores_of(protocol, record(0), record(1, turn_deg=3), record(2, shift_cm=3))
    written = write_report(tmp_path, [scores])
    assert [path.name for path in written] == ["scores.json", "curves.png", "table.md"]
    fields = json.loads((tmp_path / "scores.json").read_text())
    assert fields.keys() >= {"protocol", "iou", "data", "tracker", "mean", "per_category"}
    assert (fields["protocol"], fields["tracker"]) == (protocol, "mine")
    assert 0 <= fields["mean"]["5deg5cm"] <= 100
    assert fields["per_category"].keys() == {"camera"}
    for published in PUBLISHED.get(protocol, ()):
        assert published.method in (tmp_path / "table.md").read_text()


def test_undefined_is_null_in_json_and_a_dash_in_the_table(tmp_path):
    scores = scores_of("6pack", record(0, missing=True))
    write_report(tmp_path, [scores])
    fields = json.loads((tmp_path / "scores.json").read_text())
    assert fields["mean"]["R_err_deg"] is None
    assert fields["mean"]["5deg5cm"] == 0
    assert "| **mine** | 0.0 | 0.0 | – | – |" in (tmp_path / "table.md").read_text()


def test_several_trackers_share_one_table(tmp_path):
    one = Scores("ycbv-auc", None, {"ADD_auc": 50.0}, {}, tracker="a", data="d")
    two = Scores("ycbv-auc", None, {"ADD_auc": 60.0}, {}, tracker="b", data="d")
    write_report(tmp_path, [one, two])
    assert (tmp_path / "a" / "scores.json").is_file()
    assert (tmp_path / "b" / "scores.json").is_file()
    text = (tmp_path / "table.md").read_text()
    assert "| **a** | 50.0 |" in text
    assert "| **b** | 60.0 |" in text


def test_the_headline_iou_stands_once_in_the_table():
    text = markdown([scores_of("aerial", record(0), record(1))])
    heading = text.splitlines()[2]
    assert "| IoU25 nocs_official | IoU25 aabb_fixed | IoU25 obb_exact |" in heading
    assert heading.count("IoU25") == 3
    assert "IoU `obb_exact`" in text


def test_every_protocol_is_told_with_its_caveats():
    assert PUBLISHED.keys() <= PROTOCOLS.keys()
    assert CAVEATS.keys() == PROTOCOLS.keys()
    with pytest.raises(InputError, match="aerial, nocs-map"):
        find_protocol("bop")


def test_curves_count_what_lies_at_or_below():
    import numpy as np

    assert cumulative(np.array([1.0, 2.0, np.inf]), np.array([0, 1, 2])) == pytest.approx(
        [0, 100 / 3, 200 / 3]
    )


@pytest.mark.parametrize(
    ("kind", "expected"),
    [("recorded images", "published;"), ("synthetic", "published, real images: NOT comparable;")],
)
def test_published_figures_say_whether_they_compare(kind, expected):
    scores = Scores("6pack", "nocs_official", {"5deg5cm": 50.0}, {}, details={"data_kind": kind})
    line = f"| BundleTrack | 87.4 | {expected} left out of the paper's table |"
    assert line in markdown([scores])
