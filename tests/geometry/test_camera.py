"""Projection and back-projection undo each other; a foreign K is refused."""

import numpy as np
import pytest

from robust6dof.errors import InputError
from robust6dof.geometry.camera import backproject, check_intrinsics, project

K = np.array([[600.0, 0.0, 320.0], [0.0, 590.0, 240.0], [0.0, 0.0, 1.0]])


def test_backproject_inverts_project() -> None:
    rng = np.random.default_rng(0)
    depth = rng.uniform(0.3, 2.0, size=(12, 16))
    depth[2, 3], depth[4, 5] = 0.0, np.nan
    points_cam, pixels = backproject(depth, K)
    assert len(points_cam) == 12 * 16 - 2
    np.testing.assert_allclose(project(points_cam, K), pixels, atol=1e-9)


@pytest.mark.parametrize(
    ("broken", "message"),
    [
        (K.T, "column-major"),
        (K * [[2], [2], [1]], "another image size"),
        (np.full((3, 3), np.nan), "finite"),
        (K * [[-1], [1], [1]], "focal"),
    ],
)
def test_foreign_intrinsics_are_refused(broken: np.ndarray, message: str) -> None:
    with pytest.raises(InputError, match=message):
        check_intrinsics(broken, 640, 480)
