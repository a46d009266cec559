import numpy as np

from core.embossing.check import is_closed

QUAD = np.array([[0, 1, 2], [0, 2, 3]])
RING = np.array([[0, 1], [1, 2], [2, 3], [3, 0]])


def test_the_same_hole_filled_another_way_is_accepted() -> None:
    assert is_closed(QUAD, RING, np.array([[0, 1, 3], [1, 2, 3]]))
    assert is_closed(QUAD, RING, np.array([[0, 1, 9], [1, 2, 9], [2, 3, 9], [3, 0, 9]]))


def test_a_missing_triangle_is_refused() -> None:
    assert not is_closed(QUAD, RING, np.array([[0, 1, 9], [1, 2, 9], [2, 3, 9]]))


def test_a_triangle_turned_over_is_refused() -> None:
    assert not is_closed(QUAD, RING, np.array([[0, 1, 9], [1, 2, 9], [2, 3, 9], [0, 3, 9]]))


def test_an_edge_with_a_third_and_fourth_face_is_refused() -> None:
    fins = np.array([[0, 2, 9], [2, 0, 9]])
    assert not is_closed(QUAD, RING, np.concatenate([QUAD, fins]))


def test_a_flat_triangle_is_refused() -> None:
    assert not is_closed(QUAD, RING, np.concatenate([QUAD, [[0, 2, 2]]]))


def test_a_vertex_added_on_the_rim_is_refused() -> None:
    assert not is_closed(QUAD, RING, np.array([[0, 9, 2], [9, 1, 2], [0, 2, 3]]))
