"""A vehicle in the air, for the tests of this folder."""

import numpy as np

from robust6dof.geometry.transforms import make_transform
from robust6dof.robot.aerial_manipulator import default_aerial_manipulator
from robust6dof.simulation.air import WindConfig
from robust6dof.simulation.estimator import EstimatorNoise
from robust6dof.simulation.plant import AerialPlant, PlantConfig
from robust6dof.synthetic.room import Surface

FLOOR = Surface((0.0, 0.0), (20.0, 20.0), 0.0)
CALM = PlantConfig(noise=EstimatorNoise.none(), wind=WindConfig(turbulence=(0.0, 0.0, 0.0)))


def airborne(config: PlantConfig = CALM, *, height: float = 1.5, seed: int = 0, joints=None):
    manipulator = default_aerial_manipulator()
    start = make_transform(np.eye(3), np.array([0.0, 0.0, height]))
    joints = manipulator.arm.rest.copy() if joints is None else joints
    rng = np.random.default_rng(seed)
    return AerialPlant(manipulator, config, (FLOOR,), start, joints, rng)
