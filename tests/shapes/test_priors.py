"""Category priors: shipped ones, and ones built from few objects."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from robust6dof.cli import main
from robust6dof.errors import DataError, InputError
from robust6dof.frames import CATEGORIES, SYMMETRIC_CATEGORIES
from robust6dof.shapes.loading import load_category
from robust6dof.shapes.mesh import ObjectModel, TexturedMesh
from robust6dof.shapes.priors import (
    PRIORS_VARIABLE,
    PriorConfig,
    build_prior,
    chamfer,
    load_prior,
    read_prior,
)
from robust6dof.shapes.procedural import make_object
from robust6dof.shapes.sampling import sample_surface
from shared_data import shared_data

SMALL = PriorConfig(template_points=6000, control_points=300, instance_points=600)


def box(*sides: float) -> ObjectModel:
    made = trimesh.creation.box(sides)
    texture = np.zeros((1, 1, 3), np.uint8)
    mesh = TexturedMesh(np.array(made.vertices), np.array(made.faces), np.zeros((8, 2)), texture)
    return ObjectModel(mesh, "box", "box")


@pytest.mark.parametrize("category", CATEGORIES)
def test_shipped_prior_is_canonical(category: str) -> None:
    points = load_prior(category)
    assert points.shape == (2048, 3)
    assert points.dtype == np.float32
    np.testing.assert_allclose(points.min(axis=0) + points.max(axis=0), 0, atol=1e-5)
    assert np.linalg.norm(np.ptp(points, axis=0)) == pytest.approx(1.0, abs=1e-5)


@pytest.mark.parametrize("category", sorted(SYMMETRIC_CATEGORIES))
def test_shipped_prior_is_round_where_azimuth_means_nothing(category: str) -> None:
    points = load_prior(category)
    turned = points @ np.array([[0, 0, 1], [0, 1, 0], [-1, 0, 0]], np.float32)
    assert chamfer(points, turned) < 0.02


def test_shipped_priors_point_the_canonical_way() -> None:
    mug, laptop, camera = (load_prior(name) for name in ("mug", "laptop", "camera"))
    # The handle is thin along z and lies at +x; the lid is high at −x; the lens narrow at +x.
    assert np.ptp(mug[mug[:, 0] > 0.75 * mug[:, 0].max(), 2]) < 0.4 * np.ptp(mug[:, 2])
    assert laptop[laptop[:, 1] > 0, 0].mean() < -0.1
    front, back = (camera[sign * camera[:, 0] > 0.15] for sign in (1, -1))
    assert np.ptp(front[:, 2]) < np.ptp(back[:, 2])


@pytest.mark.parametrize("category", CATEGORIES)
def test_prior_is_closer_to_new_objects_than_they_are_to_each_other(category: str) -> None:
    rng = np.random.default_rng(0)
    made = [make_object(category, seed) for seed in range(10)]
    clouds = [sample_surface(one.mesh, 1000, rng)[0] / one.scale for one in made]
    prior = load_prior(category)[:1000]
    to_prior = np.mean([chamfer(prior, cloud) for cloud in clouds])
    pairs = [chamfer(a, b) for i, a in enumerate(clouds) for b in clouds[:i]]
    assert to_prior < np.mean(pairs)


def test_mean_of_two_boxes_is_the_box_between() -> None:
    prior = build_prior([box(0.1, 0.2, 0.3), box(0.2, 0.2, 0.3)], config=SMALL)
    ends = [np.array([0.1, 0.2, 0.3]), np.array([0.2, 0.2, 0.3])]
    middle = np.mean([side / np.linalg.norm(side) for side in ends], axis=0)
    np.testing.assert_allclose(np.ptp(prior, axis=0), middle / np.linalg.norm(middle), atol=0.025)


def test_prior_of_one_object_is_its_surface() -> None:
    prior = build_prior([box(0.1, 0.2, 0.3)], config=SMALL)
    half = np.array([0.1, 0.2, 0.3]) / np.linalg.norm([0.1, 0.2, 0.3]) / 2
    # Every point lies on a face of the box.
    assert np.abs(np.abs(prior) - half).min(axis=1).max() < 0.01


def test_prior_points_are_even() -> None:
    points = load_prior("can")
    distance = np.linalg.norm(points[:, None] - points[None], axis=2)
    np.fill_diagonal(distance, np.inf)
    nearest = distance.min(axis=1)
    assert nearest.std() < 0.35 * nearest.mean()


def test_objects_of_two_categories_are_refused() -> None:
    with pytest.raises(InputError, match="same category"):
        build_prior([box(0.1, 0.1, 0.1), make_object("can", 0)])


def test_unknown_category_names_the_command() -> None:
    with pytest.raises(InputError, match="robust6dof priors --category spoon"):
        load_prior("spoon")


def test_what_is_no_prior_is_refused(tmp_path: Path) -> None:
    np.save(tmp_path / "few.npy", np.zeros((5, 3)))
    with pytest.raises(DataError, match="2048"):
        read_prior(tmp_path / "few.npy")
    (tmp_path / "text.npy").write_text("no")
    with pytest.raises(DataError, match="not a readable prior"):
        read_prior(tmp_path / "text.npy")


def test_command_builds_a_prior_of_a_new_category(tmp_path: Path) -> None:
    folder = tmp_path / "meshes" / "crate"
    folder.mkdir(parents=True)
    trimesh.creation.box((0.1, 0.2, 0.3)).export(folder / "crate.ply")
    out = tmp_path / "new" / "crate.npy"
    arguments = ["--category", "crate", "--meshes", str(folder.parent), "--out", str(out)]
    assert main(["priors", *arguments]) == 0
    expected = np.array([0.1, 0.2, 0.3]) / np.linalg.norm([0.1, 0.2, 0.3])
    np.testing.assert_allclose(np.ptp(read_prior(out), axis=0), expected, atol=0.01)


def test_command_says_which_folder_is_missing(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["--category", "crate", "--meshes", str(tmp_path), "--out", "x.npy"]
    assert main(["priors", *arguments]) == 1
    assert "no meshes of category 'crate'" in capsys.readouterr().err


@pytest.mark.parametrize("category", CATEGORIES)
def test_scanned_objects_are_nearest_to_the_prior_of_their_category(category: str) -> None:
    """On average over a category: a single slim can is as near to a bottle."""
    rng = np.random.default_rng(0)
    scans = load_category(shared_data("meshes"), category)
    clouds = [sample_surface(scan.mesh, 2048, rng)[0] / scan.scale for scan in scans]
    distances = {
        name: np.mean([chamfer(load_prior(name), cloud) for cloud in clouds]) for name in CATEGORIES
    }
    assert min(distances, key=distances.__getitem__) == category, distances
    assert distances[category] < 0.06


def test_a_prior_of_the_users_own_is_found_by_its_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv(PRIORS_VARIABLE, raising=False)
    with pytest.raises(InputError, match=PRIORS_VARIABLE):
        load_prior("teapot")
    points = load_prior("mug")[::-1]
    np.save(tmp_path / "teapot.npy", points)
    np.save(tmp_path / "can.npy", points)
    monkeypatch.setenv(PRIORS_VARIABLE, str(tmp_path))
    np.testing.assert_array_equal(load_prior("teapot"), points)
    np.testing.assert_array_equal(load_prior("can"), points)
    assert load_prior("mug").shape == (2048, 3)
