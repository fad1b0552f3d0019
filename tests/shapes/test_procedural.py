"""Procedural objects: closed surfaces, canonical frame, reproducible, varied."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from robust6dof.errors import InputError
from robust6dof.frames import CATEGORIES
from robust6dof.shapes.mesh import ObjectModel
from robust6dof.shapes.procedural import MAKERS, make_object
from robust6dof.shapes.solid import merge_by_position

SEEDS = range(12)


def closed_surface(made: ObjectModel) -> trimesh.Trimesh:
    """The mesh with its texture seams merged."""
    first, place = merge_by_position(made.mesh.vertices)
    return trimesh.Trimesh(made.mesh.vertices[first], place[made.mesh.faces], process=False)


def test_every_category_of_the_paper_has_a_maker() -> None:
    assert tuple(MAKERS) == CATEGORIES


@pytest.mark.parametrize("category", CATEGORIES)
def test_surface_is_closed_outward_and_in_one_piece(category: str) -> None:
    for seed in SEEDS:
        surface = closed_surface(make_object(category, seed))
        assert surface.is_watertight, seed
        assert surface.is_winding_consistent, seed
        assert surface.volume > 0, seed
        assert surface.body_count == 1, seed


@pytest.mark.parametrize("category", CATEGORIES)
def test_object_is_centred_and_of_household_size(category: str) -> None:
    for seed in SEEDS:
        made = make_object(category, seed)
        middle = made.mesh.vertices.min(axis=0) + made.mesh.vertices.max(axis=0)
        np.testing.assert_allclose(middle, 0.0, atol=1e-9)
        assert 0.04 < made.scale < 0.7


@pytest.mark.parametrize("category", CATEGORIES)
def test_texture_coordinates_lie_in_the_texture(category: str) -> None:
    made = make_object(category, 3)
    assert made.mesh.uv.min() >= 0
    assert made.mesh.uv.max() <= 1
    assert max(made.mesh.texture.shape) <= 256


@pytest.mark.parametrize("category", CATEGORIES)
def test_same_seed_same_object(category: str) -> None:
    one, other = make_object(category, 5), make_object(category, 5)
    np.testing.assert_array_equal(one.mesh.vertices, other.mesh.vertices)
    np.testing.assert_array_equal(one.mesh.texture, other.mesh.texture)
    assert one.parameters == other.parameters
    assert not np.array_equal(one.extents, make_object(category, 6).extents)


def test_generator_is_advanced() -> None:
    rng = np.random.default_rng(0)
    assert not np.array_equal(make_object("mug", rng).extents, make_object("mug", rng).extents)


def test_unknown_category_names_the_known_ones() -> None:
    with pytest.raises(InputError, match="bottle, bowl"):
        make_object("spoon", 0)
