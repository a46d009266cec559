import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linprog
from scipy.spatial.transform import Rotation

from core.arrays import Float
from core.geometry.boxes import Boxes
from core.geometry.overlap import boxes_meet, triangles_meet

SEEDS = st.integers(0, 2**32 - 1)
UNIT = (np.full(3, -1.0), np.full(3, 1.0))


def _apart(corners: Float, low: Float, high: Float, slack: float) -> bool:
    """Whether no point in the hull of ``corners`` lies in the box grown by ``slack``: a linear programme decides."""
    rows = np.concatenate([corners.T, -corners.T])
    bounds = np.concatenate([high + slack, slack - low])
    return bool(linprog(np.zeros(len(corners)), rows, bounds, np.ones((1, len(corners))), [1.0]).status == 2)


def _agrees(found: bool, corners: Float, low: Float, high: Float) -> bool:
    """Whether the programme says so, too; bodies that all but touch may be judged either way."""
    return not _apart(corners, low, high, 1e-6) if found else _apart(corners, low, high, -1e-6)


def _upright(rng: np.random.Generator) -> tuple[Float, Float]:
    low = rng.uniform(-2, 1, 3)
    return low, low + rng.uniform(0.1, 2, 3)


def _boxes(rng: np.random.Generator, count: int) -> Boxes:
    axes = Rotation.random(count, random_state=rng).as_matrix()
    return Boxes(rng.uniform(-3, 3, (count, 3)), axes, rng.uniform(0.1, 3, (count, 3)))


@given(SEEDS)
def test_triangles_meet_a_box_where_a_linear_programme_finds_a_common_point(seed: int) -> None:
    rng = np.random.default_rng(seed)
    triangles, (low, high) = rng.uniform(-4, 4, (6, 3, 3)), _upright(rng)
    for triangle, found in zip(triangles, triangles_meet(triangles, low, high), strict=True):
        assert _agrees(found, triangle, low, high)


@given(SEEDS)
def test_boxes_meet_where_a_linear_programme_finds_a_common_point(seed: int) -> None:
    rng = np.random.default_rng(seed)
    boxes, upright = _boxes(rng, 4), [_upright(rng) for _ in range(3)]
    found = boxes_meet(boxes, np.array(upright))
    for corners, row in zip(boxes.corners(), found, strict=True):
        for (low, high), meets in zip(upright, row, strict=True):
            assert _agrees(meets, corners, low, high)


@given(SEEDS)
def test_whatever_a_sample_finds_in_both_is_found_to_meet(seed: int) -> None:
    rng = np.random.default_rng(seed)
    low, high = _upright(rng)
    triangles, boxes = rng.uniform(-4, 4, (50, 3, 3)), _boxes(rng, 50)
    inside_triangles = rng.dirichlet(np.ones(3), (50, 200)) @ triangles
    local = rng.uniform(-0.5, 0.5, (50, 200, 3)) * boxes.size[:, None]
    inside_boxes = np.einsum("bnj,bji->bni", local, boxes.axes) + boxes.center[:, None]
    for points, found in (
        (inside_triangles, triangles_meet(triangles, low, high)),
        (inside_boxes, boxes_meet(boxes, np.array([[low, high]]))[:, 0]),
    ):
        common = np.all((points >= low) & (points <= high), axis=2).any(axis=1)
        assert found[common].all()


def test_a_large_triangle_meets_a_box_that_holds_none_of_its_corners() -> None:
    across = np.array([[[-9.0, -9, 0], [9, -9, 0], [0, 9, 0]]])
    assert triangles_meet(across, *UNIT).all()


def test_a_triangle_across_the_corner_of_a_box_is_apart_though_their_extents_overlap() -> None:
    past_an_edge = np.array([[[2.5, 0, 0], [0, 2.5, 0], [2.5, 2.5, 0.5]]])
    assert not triangles_meet(past_an_edge, *UNIT).any()


def test_what_touches_meets() -> None:
    on_top = np.array([[[-1.0, 1, -1], [1, 1, -1], [0, 1, 1]], [[-1.0, 1.1, -1], [1, 1.1, -1], [0, 1.1, 1]]])
    assert triangles_meet(on_top, *UNIT).tolist() == [True, False]
    beside = Boxes(np.array([[2.0, 0, 0], [2.1, 0, 0]]), np.tile(np.eye(3), (2, 1, 1)), np.full((2, 3), 2.0))
    assert boxes_meet(beside, np.array([UNIT])).ravel().tolist() == [True, False]


def test_triangles_without_area_are_points_and_lines() -> None:
    collapsed = np.array([[[0.0, 0, 0]] * 3, [[3.0, 0, 0]] * 3, [[-9.0, 0, 0], [9, 0, 0], [9, 0, 0]]])
    assert triangles_meet(collapsed, *UNIT).tolist() == [True, False, True]


def test_nothing_meets_no_box() -> None:
    assert boxes_meet(_boxes(np.random.default_rng(0), 3), np.zeros((0, 2, 3))).shape == (3, 0)
    assert triangles_meet(np.zeros((0, 3, 3)), *UNIT).shape == (0,)
