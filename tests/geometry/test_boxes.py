"""The three IoUs against hand-computed cases, a naive reference and an independent package."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from robust6dof.geometry.boxes import box_corners, box_iou, intersection_volume
from robust6dof.geometry.transforms import make_transform, rotation_about_y

# Computed with cpas_toolbox 1.0.0 (half-space intersection and convex hull): rotation vector,
# centre and extents of box a, the same of box b; IoU.
CPAS_CASES = [
    (
        [
            0.001,
            0.299,
            -0.274,
            -0.033,
            -0.024,
            0.845,
            0.041,
            0.212,
            0.207,
            -0.62,
            0.49,
            0.357,
            -0.029,
            -0.007,
            0.801,
            0.156,
            0.249,
            0.206,
        ],
        0.1749023783,
    ),
    (
        [
            -1.901,
            -1.29,
            -1.842,
            -0.041,
            0.014,
            0.745,
            0.047,
            0.148,
            0.138,
            -0.539,
            -0.049,
            0.113,
            -0.0,
            -0.03,
            0.741,
            0.08,
            0.185,
            0.082,
        ],
        0.1634100895,
    ),
    (
        [
            -0.808,
            -0.033,
            0.884,
            -0.041,
            -0.028,
            0.846,
            0.147,
            0.218,
            0.174,
            1.359,
            -1.547,
            0.859,
            0.001,
            0.045,
            0.783,
            0.166,
            0.052,
            0.121,
        ],
        0.0439471146,
    ),
    (
        [
            0.577,
            -0.189,
            0.683,
            -0.014,
            0.057,
            0.811,
            0.167,
            0.174,
            0.182,
            0.127,
            -1.187,
            -0.579,
            -0.012,
            -0.048,
            0.856,
            0.085,
            0.181,
            0.103,
        ],
        0.0819306280,
    ),
    (
        [
            -1.992,
            -0.463,
            -0.097,
            0.041,
            0.053,
            0.848,
            0.16,
            0.071,
            0.08,
            -0.428,
            -0.304,
            0.353,
            0.046,
            0.017,
            0.808,
            0.119,
            0.126,
            0.09,
        ],
        0.1538337703,
    ),
    (
        [
            0.653,
            -0.024,
            0.668,
            0.006,
            -0.021,
            0.83,
            0.045,
            0.118,
            0.046,
            -1.688,
            -2.035,
            -0.304,
            -0.009,
            0.003,
            0.845,
            0.112,
            0.164,
            0.184,
        ],
        0.0537607349,
    ),
    (
        [
            0.493,
            -0.176,
            -0.206,
            0.049,
            -0.042,
            0.852,
            0.041,
            0.198,
            0.21,
            0.26,
            -0.858,
            0.972,
            -0.058,
            0.015,
            0.835,
            0.148,
            0.192,
            0.088,
        ],
        0.0052726107,
    ),
    (
        [
            0.363,
            -2.129,
            0.847,
            -0.018,
            0.054,
            0.809,
            0.111,
            0.097,
            0.24,
            1.249,
            1.442,
            -0.066,
            0.003,
            0.048,
            0.829,
            0.162,
            0.13,
            0.224,
        ],
        0.2442459017,
    ),
    (
        [
            -0.793,
            -0.626,
            -1.278,
            -0.008,
            0.002,
            0.854,
            0.093,
            0.209,
            0.182,
            -0.56,
            0.008,
            -0.375,
            -0.012,
            -0.036,
            0.746,
            0.085,
            0.232,
            0.216,
        ],
        0.1118763296,
    ),
    (
        [
            0.337,
            1.407,
            -1.454,
            0.019,
            -0.023,
            0.855,
            0.138,
            0.172,
            0.173,
            -0.752,
            0.455,
            -0.539,
            0.032,
            0.038,
            0.828,
            0.064,
            0.232,
            0.208,
        ],
        0.2435475905,
    ),
    (
        [
            -0.034,
            -0.441,
            -0.508,
            -0.054,
            -0.056,
            0.742,
            0.093,
            0.092,
            0.079,
            0.383,
            -0.564,
            -1.382,
            -0.04,
            0.021,
            0.743,
            0.105,
            0.237,
            0.153,
        ],
        0.0348281166,
    ),
    (
        [
            0.921,
            -0.456,
            1.515,
            -0.037,
            0.009,
            0.745,
            0.208,
            0.242,
            0.219,
            -1.145,
            -1.689,
            0.817,
            -0.046,
            0.015,
            0.836,
            0.106,
            0.221,
            0.207,
        ],
        0.2413433085,
    ),
]


def boxes(R, t, extents):
    return make_transform(np.asarray(R), np.asarray(t))[None], np.asarray(extents, float)[None]


def random_boxes(rng, n, spread=0.1):
    T = np.tile(np.eye(4), (n, 1, 1))
    T[:, :3, :3] = Rotation.random(n, rng=rng).as_matrix()
    T[:, :3, 3] = rng.uniform(-spread, spread, (n, 3)) + [0, 0, 0.8]
    return T, rng.uniform(0.05, 0.3, (n, 3))


def test_corners_span_the_extents():
    T, extents = random_boxes(np.random.default_rng(0), 5)
    corners = box_corners(T, extents)
    for axis in range(3):
        along = np.einsum("ncd,nd->nc", corners - T[:, None, :3, 3], T[:, :3, axis])
        np.testing.assert_allclose(np.ptp(along, axis=1), extents[:, axis])


@pytest.mark.parametrize(("case", "expected"), CPAS_CASES)
def test_exact_iou_agrees_with_cpas_toolbox(case, expected):
    v = np.array(case)
    a = boxes(Rotation.from_rotvec(v[:3]).as_matrix(), v[3:6], v[6:9])
    b = boxes(Rotation.from_rotvec(v[9:12]).as_matrix(), v[12:15], v[15:18])
    assert box_iou("obb_exact", *a, *b)[0] == pytest.approx(expected, abs=1e-7)


def test_exact_volume_agrees_with_sampling():
    rng = np.random.default_rng(1)
    T_a, extents_a = random_boxes(rng, 20)
    T_b, extents_b = random_boxes(rng, 20)
    volumes = intersection_volume(T_a, extents_a, T_b, extents_b)
    unit = rng.uniform(-0.5, 0.5, (40_000, 3))
    for i in range(20):
        points = (unit * extents_a[i]) @ T_a[i, :3, :3].T + T_a[i, :3, 3]
        inside = np.abs((points - T_b[i, :3, 3]) @ T_b[i, :3, :3]) <= extents_b[i] / 2
        share = inside.all(axis=1).mean()
        assert volumes[i] / extents_a[i].prod() == pytest.approx(share, abs=0.012)


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 2**32 - 1))
def test_exact_iou_is_symmetric_bounded_and_rigid_invariant(seed):
    rng = np.random.default_rng(seed)
    a, b = random_boxes(rng, 4), random_boxes(rng, 4)
    iou = box_iou("obb_exact", *a, *b)
    assert ((iou >= 0) & (iou <= 1)).all()
    np.testing.assert_allclose(iou, box_iou("obb_exact", *b, *a), atol=1e-7)
    T_moved = make_transform(Rotation.random(rng=rng).as_matrix(), rng.normal(size=3))
    moved = box_iou("obb_exact", T_moved @ a[0], a[1], T_moved @ b[0], b[1])
    np.testing.assert_allclose(iou, moved, atol=1e-7)


@pytest.mark.parametrize("kind", ["nocs_official", "aabb_fixed", "obb_exact"])
def test_a_box_with_itself_is_one(kind):
    T, extents = random_boxes(np.random.default_rng(2), 50)
    np.testing.assert_allclose(box_iou(kind, T, extents, T, extents), 1.0, atol=1e-8)


@pytest.mark.parametrize(
    ("shift", "extents_b", "expected"),
    [
        ([0.5, 0, 0], [1, 1, 1], 1 / 3),
        ([0.5, 0.5, 0], [1, 1, 1], 1 / 7),
        ([0, 0, 0], [0.5, 0.5, 0.5], 1 / 8),
        ([0.25, 0.25, 0.25], [0.5, 0.5, 0.5], 1 / 8),
        ([0, 0, 0.25], [0.5, 1, 0.5], 1 / 4),
        ([1, 0, 0], [1, 1, 1], 0.0),
        ([2, 0, 0], [1, 1, 1], 0.0),
    ],
)
def test_aligned_boxes_by_hand(shift, extents_b, expected):
    """Coinciding faces on one, two and three sides are where a careless clip counts twice."""
    a, b = boxes(np.eye(3), [0, 0, 3], [1, 1, 1]), boxes(np.eye(3), shift, extents_b)
    b[0][:, 2, 3] += 3
    for kind in ("aabb_fixed", "obb_exact"):
        assert box_iou(kind, *a, *b)[0] == pytest.approx(expected, abs=1e-7)


def test_a_square_turned_by_45_degrees():
    """Two unit squares crossed at 45° share an octagon of area 2(√2 − 1)."""
    octagon = 2 * (np.sqrt(2) - 1)
    a = boxes(np.eye(3), [0, 0, 2], [1, 1, 1])
    b = boxes(rotation_about_y(np.pi / 4), [0, 0, 2], [1, 1, 1])
    assert box_iou("obb_exact", *a, *b)[0] == pytest.approx(octagon / (2 - octagon), abs=1e-7)
    assert box_iou("aabb_fixed", *a, *b)[0] == pytest.approx(1 / 2)


def test_nocs_official_takes_the_extremes_of_each_corner():
    """The naive loop over the eight corners, one interval for each."""
    rng = np.random.default_rng(3)
    T_a, extents_a = random_boxes(rng, 30, 0.05)
    T_b, extents_b = random_boxes(rng, 30, 0.05)
    iou = box_iou("nocs_official", T_a, extents_a, T_b, extents_b)
    for i in range(30):
        overlap = volume_a = volume_b = 1.0
        empty = False
        corners_a = box_corners(T_a[i : i + 1], extents_a[i : i + 1])[0]
        corners_b = box_corners(T_b[i : i + 1], extents_b[i : i + 1])[0]
        for p, q in zip(corners_a, corners_b, strict=True):
            width = min(p.max(), q.max()) - max(p.min(), q.min())
            empty |= width < 0
            overlap *= width
            volume_a *= p.max() - p.min()
            volume_b *= q.max() - q.min()
        overlap = 0.0 if empty else overlap
        assert iou[i] == pytest.approx(overlap / (volume_a + volume_b - overlap))


def test_nocs_official_tolerates_twenty_centimetres():
    """The published IoU25 of a can still holds 18 cm away, where the true boxes are disjoint."""
    can = np.array([0.07, 0.12, 0.07])
    a = boxes(np.diag([1.0, -1.0, -1.0]), [0, 0, 0.8], can)
    b = boxes(np.diag([1.0, -1.0, -1.0]), [0.18, 0, 0.8], can)
    assert box_iou("nocs_official", *a, *b)[0] > 0.25
    assert box_iou("aabb_fixed", *a, *b)[0] == 0.0
    assert box_iou("obb_exact", *a, *b)[0] == 0.0


@pytest.mark.parametrize("kind", ["nocs_official", "aabb_fixed", "obb_exact"])
def test_symmetry_tries_twenty_turns_of_the_first_box(kind):
    rng = np.random.default_rng(4)
    a, b = random_boxes(rng, 6, 0.03), random_boxes(rng, 6, 0.03)
    symmetric = np.array([True, False, True, False, True, True])
    iou = box_iou(kind, *a, *b, symmetric)
    for i in range(6):
        steps = range(20) if symmetric[i] else range(1)
        tried = []
        for step in steps:
            T = a[0][i : i + 1].copy()
            T[0, :3, :3] = T[0, :3, :3] @ rotation_about_y(np.radians(18 * step))
            one = slice(i, i + 1)
            tried.append(box_iou(kind, T, a[1][one], b[0][one], b[1][one])[0])
        assert iou[i] == pytest.approx(max(tried))


def test_a_full_multiple_of_18_degrees_costs_a_symmetric_box_nothing():
    T, extents = random_boxes(np.random.default_rng(5), 3)
    turned = T.copy()
    turned[:, :3, :3] = T[:, :3, :3] @ rotation_about_y(np.radians(54))
    iou = box_iou("obb_exact", turned, extents, T, extents, np.ones(3, bool))
    np.testing.assert_allclose(iou, 1.0, atol=1e-7)
