import numpy as np
import pytest

from core.arrays import Float, Int
from core.embossing.delaunay import Triangulation, triangulated
from core.geometry.triangles import doubled_area, inside_rings


def _ring(points: Float, first: int) -> Int:
    return np.column_stack([np.arange(len(points)), np.roll(np.arange(len(points)), -1)]) + first


def _square(side: float, turn: float = 0.0) -> Float:
    angle = np.radians(turn) + np.arange(4) * np.pi / 2
    return side * np.column_stack([np.cos(angle), np.sin(angle)])


def _areas(found: Triangulation) -> Float:
    return np.asarray(doubled_area(*(found.points[found.triangles[:, corner]] for corner in range(3))) / 2)


def test_triangles_know_their_neighbours_across_each_side() -> None:
    found = triangulated(np.random.default_rng(0).random((60, 2)), np.array([[0, 1], [2, 3]]))
    assert found is not None
    assert (_areas(found) > 0).all()
    start, end = found.triangles, np.roll(found.triangles, -1, axis=1)
    for one, side in zip(*np.nonzero(found.neighbours >= 0), strict=True):
        other = found.neighbours[one, side]
        sides = zip(end[other].tolist(), start[other].tolist(), strict=True)
        assert (start[one, side], end[one, side]) in list(sides)


@pytest.mark.parametrize("cut", [False, True])
def test_rings_are_filled_and_their_holes_are_not_even_where_other_edges_cross_them(cut: bool) -> None:
    outer, inner = _square(1.0), _square(0.5, 10)
    points = np.concatenate([_square(3.0), outer, inner, [[-2.5, 0.1], [2.5, -0.2]]])
    edges = np.concatenate([_ring(outer, 4), _ring(inner, 8)])
    found = triangulated(points, np.concatenate([edges, [[12, 13]]]) if cut else edges)
    assert found is not None
    assert (len(found.points) > len(points)) == cut
    inside = found.inside([outer, inner], edges)
    middle = found.points[found.triangles].mean(axis=1)
    assert inside.tolist() == inside_rings(middle, [outer, inner]).tolist()
    assert _areas(found)[inside].sum() == pytest.approx(2 - 0.5)


def test_an_edge_that_runs_through_a_point_is_a_wall_all_along() -> None:
    square = np.array([[0.0, 0], [2, 0], [2, 2], [0, 2]])
    found = triangulated(np.concatenate([square, [[1.0, 0], [1, 3], [3, 1], [-1, -1]]]), _ring(square, 0))
    assert found is not None
    assert _areas(found)[found.inside([square], _ring(square, 0))].sum() == pytest.approx(4)


def test_what_lies_to_the_left_of_a_ring_is_all_that_it_encloses() -> None:
    ring = _square(1.0)
    points = np.concatenate([ring, _square(2.0), 0.3 * np.random.default_rng(1).random((20, 2))])
    found = triangulated(points, _ring(ring, 0))
    assert found is not None
    enclosed = found.left_of(_ring(ring, 0))
    assert _areas(found)[enclosed].sum() == pytest.approx(2)
    assert (found.left_of(_ring(ring, 0)[:, ::-1]) == ~enclosed).all()
