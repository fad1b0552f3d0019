"""Category priors: 2,048 points on the mean shape of a category.

Method: each instance is centred and scaled to diagonal 1. The instance nearest to all others (the
medoid, by Chamfer distance) is the template. It is registered non-rigidly to every instance
(`registration`), which carries the template's points to each: a registered shape space. Its mean
is the template of a second round, so that little of the first one's character remains. The second
mean, sampled evenly (farthest points) and scaled to diagonal 1, is the prior. Nothing is
particular to a category; where azimuth means nothing, instances are first turned at random about y.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import resources
from pathlib import Path

import numpy as np
from jaxtyping import Float, Float32
from scipy.spatial import KDTree

from robust6dof.errors import DataError, InputError
from robust6dof.frames import CATEGORIES, SYMMETRIC_CATEGORIES, YCB_OBJECTS
from robust6dof.shapes.mesh import ObjectModel
from robust6dof.shapes.registration import Drift, register
from robust6dof.shapes.sampling import farthest_points, sample_surface

PRIOR_POINTS = 2048
"""N_r of the paper."""
PRIORS_VARIABLE = "ROBUST6DOF_PRIORS"
"""Environment variable that names the folder of the user's own priors."""


@dataclass(frozen=True)
class PriorConfig:
    """How many points stand for a shape while the prior is built."""

    template_points: int = 12_000
    """Points carried along; the prior is chosen from them."""
    control_points: int = 450
    """Centres of the non-rigid motion."""
    instance_points: int = 800
    """Points of each instance that the template is registered to."""
    rounds: int = 2
    """Times the mean becomes the template."""


@dataclass(frozen=True, eq=False)
class _Cloud:
    points: Float[np.ndarray, "N 3"]
    normals: Float[np.ndarray, "N 3"]


def build_prior(
    objects: Sequence[ObjectModel],
    seed: int = 0,
    config: PriorConfig = PriorConfig(),
    progress: Callable[[str], None] = lambda _: None,
) -> Float32[np.ndarray, "2048 3"]:
    """The prior of some objects of one category, in their canonical frame.

    Args:
        objects: one or more; with one, the prior is that object's own surface.
        seed: of the sampling.
        config: sizes.
        progress: told of each step.

    Returns:
        points on the mean shape: box centred at 0, diagonal 1.

    Raises:
        InputError: no objects, or of different categories.
    """
    if len({made.category for made in objects}) != 1:
        raise InputError("a prior needs one or more objects, all of the same category")
    rng = np.random.default_rng(seed)
    spin = objects[0].category in SYMMETRIC_CATEGORIES
    dense = [_unit_cloud(made, config.template_points, spin, rng) for made in objects]
    instances = [_thinned(cloud, config.instance_points) for cloud in dense]
    template = dense[_medoid([cloud.points for cloud in instances])]
    for number in range(config.rounds if len(objects) > 1 else 0):
        progress(f"round {number + 1} of {config.rounds}: {len(objects)} instances")
        template = _mean_shape(template, instances, config.control_points)
    return _normalised(template.points[farthest_points(template.points, PRIOR_POINTS)])


def chamfer(a: Float[np.ndarray, "N 3"], b: Float[np.ndarray, "M 3"]) -> float:
    """Mean distance to the nearest point of the other set, averaged over both directions."""
    return float(KDTree(a).query(b)[0].mean() + KDTree(b).query(a)[0].mean()) / 2


def _unit_cloud(made: ObjectModel, count: int, spin: bool, rng: np.random.Generator) -> _Cloud:
    points, normals = sample_surface(made.mesh, count, rng)
    angle = rng.uniform(0, 2 * np.pi) if spin else 0.0
    cosine, sine = np.cos(angle), np.sin(angle)
    turn = np.array([[cosine, 0, sine], [0, 1, 0], [-sine, 0, cosine]])
    return _Cloud(_scaled(points @ turn.T), normals @ turn.T)


def _scaled(points: Float[np.ndarray, "N 3"]) -> Float[np.ndarray, "N 3"]:
    low, high = points.min(axis=0), points.max(axis=0)
    return (points - (low + high) / 2) / np.linalg.norm(high - low)


def _normalised(points: Float[np.ndarray, "N 3"]) -> Float32[np.ndarray, "N 3"]:
    return _scaled(points).astype(np.float32)


def _thinned(cloud: _Cloud, count: int) -> _Cloud:
    """Fewer points, evenly spread; from a quarter of the cloud at most, for speed."""
    few = cloud.points[: 4 * count]
    kept = farthest_points(few, min(count, len(few)))
    return _Cloud(few[kept], cloud.normals[kept])


def _medoid(clouds: Sequence[Float[np.ndarray, "_ 3"]]) -> int:
    """The cloud with the least summed Chamfer distance to the others."""
    trees = [KDTree(cloud[:400]) for cloud in clouds]
    one_way = [[tree.query(cloud[:400])[0].mean() for tree in trees] for cloud in clouds]
    distances = np.array(one_way)
    return int((distances + distances.T).sum(axis=1).argmin())


def _mean_shape(template: _Cloud, instances: Sequence[_Cloud], control_points: int) -> _Cloud:
    """The template moved by the mean of its motions onto the instances.

    All motions have the same centres, so the mean motion is that of the mean weights.
    """
    control = _thinned(template, control_points)
    drifts = [
        register(control.points, control.normals, one.points, one.normals) for one in instances
    ]
    weights = np.mean([drift.weights for drift in drifts], axis=0)
    mean = Drift(control.points, weights, drifts[0].kernel_width)
    moved = mean.apply(template.points)
    return _Cloud(moved, mean.turn(template.points, template.normals))


def load_prior(category: str) -> Float32[np.ndarray, "2048 3"]:
    """The prior of a category: canonical axes, box centred at 0, diagonal 1.

    A file CATEGORY.npy in the folder that the environment variable ROBUST6DOF_PRIORS names goes
    before the shipped one, so that every command knows a category of the user's own.

    Raises:
        InputError: there is neither.
        DataError: the user's file is not a prior.
    """
    folder = os.environ.get(PRIORS_VARIABLE)
    if folder and (Path(folder) / f"{category}.npy").is_file():
        return read_prior(Path(folder) / f"{category}.npy")
    return _shipped(category).copy()


def read_prior(path: str | Path) -> Float32[np.ndarray, "2048 3"]:
    """A prior that `robust6dof priors` wrote.

    Raises:
        DataError: not such a file.
    """
    remedy = "Write one with robust6dof priors"
    try:
        points = np.load(path)
    except (OSError, ValueError) as error:
        raise DataError(path, f"not a readable prior ({error})", remedy) from error
    if not isinstance(points, np.ndarray) or points.shape != (PRIOR_POINTS, 3):
        raise DataError(path, f"not {PRIOR_POINTS} × 3 points", remedy)
    return points.astype(np.float32)


@cache
def _shipped(category: str) -> Float32[np.ndarray, "2048 3"]:
    folder = resources.files("robust6dof.shapes") / "prior_points"
    file = folder / f"{category}.npy"
    if not file.is_file():
        known = ", ".join((*CATEGORIES, *YCB_OBJECTS))
        raise InputError(
            f"no prior is known for '{category}' (there are: {known}); build one from your meshes "
            f"with robust6dof priors --category {category} --meshes DIR "
            f"--out PRIORS/{category}.npy and set {PRIORS_VARIABLE} to that folder"
        )
    with resources.as_file(file) as path:
        return read_prior(path)
