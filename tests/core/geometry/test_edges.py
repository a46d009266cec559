from collections import defaultdict

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from core.arrays import Int
from core.geometry.edges import EdgeTable, boundary_edges, connected, edge_table

triangles = arrays(np.int64, st.tuples(st.integers(0, 12), st.just(3)), elements=st.integers(0, 6))

Sides = dict[tuple[int, int], list[int]]


def by_hand(faces: Int) -> Sides:
    """The sides on each edge, found one after another."""
    sides: Sides = defaultdict(list)
    for side, (start, end) in enumerate((face[k], face[(k + 1) % 3]) for face in faces.tolist() for k in range(3)):
        sides[min(start, end), max(start, end)].append(side)
    return dict(sides)


def listed(table: EdgeTable) -> Sides:
    parts = np.split(table.sides, table.first[1:]) if len(table.first) else []
    return {(low, high): part.tolist() for (low, high), part in zip(table.ends.tolist(), parts, strict=True)}


@given(triangles)
def test_each_edge_has_the_sides_that_run_between_its_ends_in_their_order(faces: Int) -> None:
    table = edge_table(faces)
    expected = by_hand(faces)
    assert listed(table) == expected
    assert list(listed(table)) == sorted(expected)
    assert table.uses.tolist() == [len(expected[edge]) for edge in sorted(expected)]
    start, end = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    assert (table.upward == (start < end)[table.sides]).all()
    assert (table.ends[table.edge] == np.sort(np.column_stack([start, end]), axis=1)).all()


@given(triangles, st.data())
def test_the_edges_of_some_faces_are_those_of_a_mesh_without_the_others(faces: Int, data: st.DataObject) -> None:
    kept = data.draw(arrays(np.bool_, len(faces)))
    few = edge_table(faces).among(kept)
    alone = edge_table(faces[kept])
    renamed = (3 * np.flatnonzero(kept)[:, None] + np.arange(3)).ravel()
    assert listed(few) == {edge: renamed[sides].tolist() for edge, sides in listed(alone).items()}
    assert (few.upward == alone.upward).all()
    assert (few.edge.reshape(-1, 3)[~kept] == -1).all()
    assert (few.edge.reshape(-1, 3)[kept].ravel() == alone.edge).all()


@given(triangles)
def test_pairs_are_the_edges_of_two_sides_and_agree_where_these_run_opposite_ways(faces: Int) -> None:
    start = faces.ravel().tolist()
    one, two, agree = edge_table(faces).pairs()
    expected = [
        (*sides, start[sides[0]] != start[sides[1]]) for _, sides in sorted(by_hand(faces).items()) if len(sides) == 2
    ]
    assert list(zip(one.tolist(), two.tolist(), agree.tolist(), strict=True)) == expected


@given(triangles)
def test_components_are_what_a_walk_over_edges_reaches(faces: Int) -> None:
    number = edge_table(faces).components()
    together = [{side // 3 for side in sides} for sides in by_hand(faces).values()]
    for face in range(len(faces)):
        reached = {face}
        while more := {other for group in together if group & reached for other in group} - reached:
            reached |= more
        assert set(np.flatnonzero(number == number[face]).tolist()) == reached


def test_groups_are_numbered_by_their_first_item() -> None:
    assert connected(5, np.array([3, 1]), np.array([0, 4])).tolist() == [0, 1, 2, 0, 1]


@given(triangles)
def test_boundary_sides_have_no_opposite(faces: Int) -> None:
    sides = [(face[k], face[(k + 1) % 3]) for face in faces.tolist() for k in range(3)]
    expected = [side for side in sides if side[::-1] not in sides]
    assert list(map(tuple, boundary_edges(faces).tolist())) == expected
