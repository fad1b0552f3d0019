"""The surface remembered: shapes are averaged over all views, colours follow the newest."""

from dataclasses import replace

import numpy as np

from robust6dof.tracking.surface.cloud import Cloud
from robust6dof.tracking.surface.fit_quality import FitQuality
from robust6dof.tracking.surface.icp_config import IcpConfig
from robust6dof.tracking.surface.surface_model import SurfaceModel

GOOD = FitQuality(1.0, 0.0, 0.0, 500, 1.0, 0.1, 0.02)


def view(height: float, grey: float) -> Cloud:
    """One point of a level surface."""
    up = np.array([[0.0, 0.0, 1.0]])
    return Cloud(np.array([[0.0, 0.0, height]]), up, np.full((1, 3), grey))


def test_a_lid_that_darkens_is_learned_while_its_place_is_averaged() -> None:
    model = SurfaceModel.empty(0.01)
    for _ in range(9):
        model = model.merged(view(0.001, 200.0), 1.0)
    model = model.merged(view(0.002, 100.0), 1.0)
    np.testing.assert_allclose(model.cloud.points[0, 2], 0.0011)
    np.testing.assert_allclose(model.cloud.color[0], 150.0)
    np.testing.assert_allclose(model.merged(view(0.001, 100.0), 1.0).cloud.color[0], 125.0)


def test_other_colours_cost_confidence_but_not_in_the_shape() -> None:
    other = replace(GOOD, color_gap=0.11)
    assert other.shape_confidence == GOOD.shape_confidence == GOOD.confidence
    np.testing.assert_allclose(other.confidence, 0.5 * GOOD.confidence)
    assert GOOD.color_gap < other.color_gap < IcpConfig().growth_color_gap
