"""A tracker's own errors are measured, left out where they are none, and replayed as they were."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from evaluation.small_recordings import make_lost, make_standing, write_recording
from robust6dof.errors import DataError
from robust6dof.evaluation.predict import predict
from robust6dof.evaluation.run_info import RunInfo
from robust6dof.geometry.transforms import axis_error, make_transform, rotation_about_y
from robust6dof.tracking.view import ViewConfig
from robust6dof.training.pairs import PairConfig, SyntheticPairs
from robust6dof.training.prediction_errors import ErrorConfig, ErrorSource, PoseError
from robust6dof.training.replayed_errors import read_errors

VIEW = ViewConfig(points=48, crop_px=24)


def _random_transform(rng: np.random.Generator) -> np.ndarray:
    return make_transform(Rotation.random(rng=rng).as_matrix(), rng.normal(size=3))


@pytest.mark.parametrize("seed", range(5))
def test_an_error_applied_to_the_truth_is_the_estimate(seed: int) -> None:
    rng = np.random.default_rng(seed)
    T_true, T_est = _random_transform(rng), _random_transform(rng)
    error = PoseError.between(T_true, T_est, np.ones(3))
    np.testing.assert_allclose(error.applied(T_true), T_est, atol=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_a_symmetric_object_has_no_error_of_yaw(seed: int) -> None:
    """Its axis is off as much as before, and no turn about y would bring it nearer."""
    rng = np.random.default_rng(seed)
    T_true = _random_transform(rng)
    tilt = Rotation.from_rotvec([0.1, 0.0, -0.2]).as_matrix()
    R_est = T_true[:3, :3] @ rotation_about_y(rng.uniform(-3, 3)) @ tilt
    error = PoseError.between(T_true, make_transform(R_est, T_true[:3, 3]), np.ones(3), True)
    replayed = error.applied(T_true)[:3, :3]
    assert axis_error(replayed, T_true[:3, :3]) == pytest.approx(
        axis_error(R_est, T_true[:3, :3]), abs=1e-9
    )
    traces = [np.trace(error.R_true_est @ rotation_about_y(turn)) for turn in (-0.05, 0.0, 0.05)]
    assert np.trace(error.R_true_est) == pytest.approx(max(traces))


@pytest.fixture
def data(tmp_path: Path) -> Path:
    """Objects that move 1 cm a frame along x."""
    write_recording(tmp_path / "data" / "a")
    return tmp_path / "data"


def _predict(make, data: Path, run: Path) -> Path:
    list(predict(make, RunInfo("standing", "ycbv-auc", str(data), 0), run))
    return run


def test_the_errors_of_a_run_are_read(data: Path, tmp_path: Path) -> None:
    """A tracker that stands still is one more centimetre behind in each frame."""
    errors = read_errors([_predict(make_standing, data, tmp_path / "run")])
    assert sorted(errors) == ["can", "mug"]
    for pairs in errors.values():
        assert len(pairs) == 4
        for frame, (first, second) in enumerate(pairs):
            np.testing.assert_allclose(first.shift_cam, [-0.01 * frame, 0, 0], atol=1e-9)
            np.testing.assert_allclose(second.shift_cam, [-0.01 * (frame + 1), 0, 0], atol=1e-9)
            np.testing.assert_allclose(first.R_true_est, np.eye(3), atol=1e-9)
            np.testing.assert_allclose(first.stretch, 1.0)


def test_frames_in_which_the_tracker_is_lost_are_left_out(data: Path, tmp_path: Path) -> None:
    run = _predict(make_lost, data, tmp_path / "run")
    assert {name: len(pairs) for name, pairs in read_errors([run]).items()} == {"can": 1, "mug": 1}


def test_what_is_no_run_is_refused(data: Path, tmp_path: Path) -> None:
    with pytest.raises(DataError, match="no run is stored"):
        read_errors([tmp_path])
    run = _predict(make_standing, data, tmp_path / "run")
    data.rename(tmp_path / "elsewhere")
    with pytest.raises(DataError, match="no such folder"):
        read_errors([run])


def _error(yaw: float, shift: float) -> PoseError:
    return PoseError(rotation_about_y(yaw), np.array([0.0, 0.0, shift]), np.full(3, 1.1))


def test_pairs_replay_what_they_are_given() -> None:
    """The two views are predicted with two errors that followed one another, about one pose."""
    given = [(_error(0.1, 0.01), _error(0.2, 0.02)), (_error(-0.1, 0.0), _error(-0.2, -0.01))]
    config = PairConfig(errors=ErrorConfig(replay_share=1.0), object_pool=2, largest_px=64)
    pairs = SyntheticPairs(VIEW, 40, 0, 9, config, ["mug"], replayed={"mug": given})
    found = set()
    for index in range(8):
        pair = pairs[index]
        T_last = pair.truth.T_cam_obj_prev[0].double().numpy()
        fits = [
            np.allclose(pair.previous.T_cam_pred[0], first.applied(T_last), atol=1e-5)
            and np.allclose(pair.current.T_cam_pred[0], second.applied(T_last), atol=1e-5)
            for first, second in given
        ]
        assert sum(fits) == 1
        found.add(fits.index(True))
        assert pair.current.scale.item() == pytest.approx(1.1 * pair.truth.scale.item(), rel=1e-5)
    assert found == {0, 1}


def test_a_share_of_the_pairs_replays_and_another_category_draws_as_ever() -> None:
    source = ErrorSource(ErrorConfig(), {"mug": [(_error(0.1, 0.0), _error(0.2, 0.0))]})
    rng = np.random.default_rng(0)
    share = np.mean([source.draw(rng, "mug").replayed is not None for _ in range(400)])
    assert share == pytest.approx(0.5, abs=0.08)
    plain, other = (
        SyntheticPairs(VIEW, 40, 0, 9, PairConfig(object_pool=2), ["can"], replayed=replayed)[3]
        for replayed in (None, {"mug": [(_error(0.1, 0.0), _error(0.2, 0.0))]})
    )
    assert torch.equal(plain.current.points, other.current.points)


def test_a_replaying_pair_depends_on_its_number_alone() -> None:
    given = {"mug": [(_error(0.1 * i, 0.0), _error(0.2, 0.0)) for i in range(5)]}
    config = PairConfig(object_pool=2, largest_px=64)
    a, b = (SyntheticPairs(VIEW, 40, 0, 9, config, ["mug"], replayed=given)[4] for _ in range(2))
    assert torch.equal(a.current.points, b.current.points)
