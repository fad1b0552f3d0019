"""Objects of the six categories, drawn from wide ranges: `make_object(category, seed)`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from robust6dof.errors import InputError
from robust6dof.shapes.bottle import make_bottle
from robust6dof.shapes.bowl import make_bowl
from robust6dof.shapes.camera import make_camera
from robust6dof.shapes.can import make_can
from robust6dof.shapes.draw import Draw
from robust6dof.shapes.laptop import make_laptop
from robust6dof.shapes.mesh import ObjectModel
from robust6dof.shapes.mug import make_mug

MAKERS: dict[str, Callable[[Draw], ObjectModel]] = {
    "bottle": make_bottle,
    "bowl": make_bowl,
    "camera": make_camera,
    "can": make_can,
    "laptop": make_laptop,
    "mug": make_mug,
}
"""Category → maker."""

PRIOR_SEEDS = 900_000_000
"""First seed of the objects that the shipped priors are made of; train and test on others."""


def make_object(category: str, seed: int | np.random.Generator) -> ObjectModel:
    """A random object of a category: a closed, textured mesh in metres.

    Its frame is the canonical one of `ObjectModel`, centred on the bounding box.

    Args:
        category: one of MAKERS.
        seed: the same integer gives the same object; or a generator, which is advanced.

    Raises:
        InputError: a category without a procedural model.
    """
    if category not in MAKERS:
        raise InputError(
            f"no procedural shapes for '{category}' (there are: {', '.join(MAKERS)}); "
            "give your own meshes of it with --meshes"
        )
    rng = seed if isinstance(seed, np.random.Generator) else _generator(category, seed)
    made = MAKERS[category](Draw(rng))
    return (
        made
        if isinstance(seed, np.random.Generator)
        else replace(made, name=f"procedural_{category}_{seed}")
    )


def _generator(category: str, seed: int) -> np.random.Generator:
    """A stream of its own for each category, so that equal seeds do not give equal colours."""
    return np.random.default_rng([list(MAKERS).index(category), seed])
