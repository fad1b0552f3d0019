"""Each rule of `6pack`, `6pack-fixed` and `captra`, by hand."""

import numpy as np
import pytest

from evaluation.pose_records import EXTENTS, TRUE_POSE, record
from robust6dof.evaluation.protocols import captra, six_pack, six_pack_fixed
from robust6dof.geometry.boxes import box_iou


@pytest.mark.parametrize("protocol", [six_pack, six_pack_fixed])
class TestSixPack:
    def test_first_frame_counts_and_missing_is_a_failure_in_the_denominator(self, protocol):
        mean = protocol.score(
            [record(0), record(1, missing=True), record(2, shift_cm=60, along="z")]
        ).mean
        assert mean["5deg5cm"] == pytest.approx(100 / 3)
        assert mean["IoU25"] == pytest.approx(100 / 3)

    def test_thresholds_are_strict(self, protocol, monkeypatch):
        for turn_deg, inside in ((5 - 1e-7, 100), (5 + 1e-7, 0)):
            assert protocol.score([record(turn_deg=turn_deg)]).mean["5deg5cm"] == inside
        for name, value in (("R_err_deg", 5.0), ("T_err_cm", 5.0)):
            with monkeypatch.context() as patch:
                patch.setattr(six_pack.PoseBatch, name, lambda self, v=value: np.array([v]))
                assert protocol.score([record()]).mean["5deg5cm"] == 0

    def test_errors_are_means_over_frames_above_iou_25_only(self, protocol):
        mean = protocol.score([record(turn_deg=4, shift_cm=2), record(shift_cm=60, along="z")]).mean
        assert mean["R_err_deg"] == pytest.approx(4)
        assert mean["T_err_cm"] == pytest.approx(2)

    def test_errors_without_any_such_frame_are_undefined(self, protocol):
        mean = protocol.score([record(shift_cm=60, along="z")]).mean
        assert np.isnan(mean["R_err_deg"])
        assert mean["IoU25"] == 0

    def test_mug_is_never_symmetric_but_a_can_is(self, protocol):
        mug = record(turn_deg=90, axis="y", category="mug", handle_visible=False)
        can = record(turn_deg=90, axis="y", category="can")
        assert protocol.score([mug]).mean["5deg5cm"] == 0
        assert protocol.score([can]).mean["5deg5cm"] == 100

    def test_predicted_extents_play_no_part(self, protocol):
        plain, wrong = record(shift_cm=3), record(shift_cm=3, extents=EXTENTS * 9)
        assert protocol.score([plain]).mean == protocol.score([wrong]).mean

    def test_mean_is_over_categories(self, protocol):
        records = [record(i) for i in range(9)] + [record(category="mug", shift_cm=9)]
        assert protocol.score(records).mean["5deg5cm"] == pytest.approx(50)


def test_six_pack_shrinks_the_truth_by_its_nocs_scale_and_the_fixed_one_does_not():
    """A shift at which the two boxes' IoUs lie on either side of 0.25."""
    scale = np.linalg.norm(EXTENTS)
    shifts = np.arange(0, 40, 0.05)
    T = np.tile(TRUE_POSE, (len(shifts), 1, 1))
    T[:, 2, 3] += shifts / 100
    truth, size = np.tile(TRUE_POSE, (len(shifts), 1, 1)), np.tile(EXTENTS, (len(shifts), 1))
    fixed = box_iou("nocs_official", truth, size, T, size) > 0.25
    official = box_iou("nocs_official", truth, size * scale, T, size) > 0.25
    between = shifts[np.flatnonzero(fixed != official)[0]]
    records = [record(shift_cm=between, along="z")]
    assert six_pack.score(records).mean["IoU25"] != six_pack_fixed.score(records).mean["IoU25"]


class TestCaptra:
    def test_first_frame_of_each_track_does_not_count(self):
        records = [
            record(0, shift_cm=50),
            record(1),
            record(3, object="b", shift_cm=50),
            record(4, object="b"),
        ]
        scores = captra.score(records)
        assert scores.mean["5deg5cm"] == 100
        assert scores.details["frames"] == 2

    def test_errors_are_neither_gated_nor_clipped(self):
        mean = captra.score([record(0), record(1, shift_cm=250, turn_deg=170)]).mean
        assert mean["T_err_cm"] == pytest.approx(250)
        assert mean["R_err_deg"] == pytest.approx(170)

    def test_threshold_is_inclusive(self, monkeypatch):
        monkeypatch.setattr(captra.PoseBatch, "R_err_deg", lambda self: np.array([5.0]))
        monkeypatch.setattr(captra.PoseBatch, "T_err_cm", lambda self: np.array([5.0]))
        assert captra.score([record(0), record(1)]).mean["5deg5cm"] == 100

    def test_iou_is_the_mean_with_the_predicted_size_on_aligned_boxes(self):
        size = EXTENTS * 0.5
        mean = captra.score([record(0), record(1, extents=size), record(2)]).mean
        T = TRUE_POSE[None]
        iou = box_iou("aabb_fixed", T, size[None], T, EXTENTS[None])[0]
        assert mean["mean_IoU"] == pytest.approx(100 * (iou + 1) / 2)
        assert mean["IoU25"] == 50

    @pytest.mark.parametrize(("category", "error"), [("bowl", 0), ("mug", 90), ("laptop", 90)])
    def test_symmetry_is_by_category_alone(self, category, error):
        hidden = record(1, turn_deg=90, axis="y", category=category, handle_visible=False)
        mean = captra.score([record(0, category=category), hidden]).mean
        assert mean["R_err_deg"] == pytest.approx(error, abs=1e-6)

    def test_a_missing_pose_fails_and_leaves_the_errors_undefined(self):
        scores = captra.score([record(0), record(1, missing=True), record(2)])
        assert scores.mean["5deg5cm"] == 50
        assert scores.mean["T_err_cm"] == np.inf
        assert scores.details["frames_missing"] == 1
        assert "missing" in scores.notes[0]
