import numpy as np

from core.analysis.coincident import find_coincident
from tests.core.shapes import box, join, surface

CUBE = box(2.0, 2.0, 2.0)
EQUAL = np.zeros(100, dtype=np.int64)


def test_a_plain_surface_is_all_distinct() -> None:
    found = find_coincident(CUBE, EQUAL[:12])
    assert found.distinct.all()
    assert not found.has_remaining_copy.any()
    assert len(found.duplicates) == 0


def test_of_a_double_sided_shell_one_side_counts_and_the_other_is_its_twin() -> None:
    found = find_coincident(surface(CUBE.positions, np.concatenate([CUBE.faces, CUBE.faces[:, ::-1]])), EQUAL[:24])
    assert found.distinct.tolist() == [True] * 12 + [False] * 12
    assert found.has_reversed_copy.tolist() == found.has_remaining_copy.tolist() == found.distinct.tolist()
    assert len(found.duplicates) == 0


def test_a_duplicate_goes_with_its_face_whatever_corner_it_starts_at() -> None:
    found = find_coincident(
        surface(CUBE.positions, np.concatenate([CUBE.faces, CUBE.faces[3:4, [2, 0, 1]]])), EQUAL[:13]
    )
    assert found.duplicates.tolist() == [[3, 12]]
    assert not found.has_remaining_copy.any()
    assert not found.not_cuttable.any()


def test_a_duplicate_at_the_rim_of_a_sheet_is_pinned() -> None:
    open_box = CUBE.faces[1:]
    found = find_coincident(surface(CUBE.positions, np.concatenate([open_box, open_box])), EQUAL[:22])
    assert found.not_cuttable.sum() == 3  # the neighbours of the missing face


def test_collapsed_faces_do_not_count() -> None:
    found = find_coincident(surface(CUBE.positions, np.concatenate([CUBE.faces, [[0, 0, 1], [2, 2, 2]]])), EQUAL[:14])
    assert found.distinct.tolist() == [True] * 12 + [False] * 2


def test_of_coincident_faces_the_highest_rank_stays() -> None:
    both = surface(CUBE.positions, np.concatenate([CUBE.faces, CUBE.faces]))
    found = find_coincident(both, np.repeat([0, 1], 12))
    assert found.distinct.tolist() == [False] * 12 + [True] * 12
    assert found.duplicates[:, 0].tolist() == list(range(12, 24))


def test_layers_of_different_nodes_coincide_but_do_not_go_together() -> None:
    both = join(CUBE, CUBE)
    apart = surface(both.positions, both.faces)
    weld = apart.weld.copy()
    weld[len(CUBE.positions) :] += int(weld.max()) + 1
    found = find_coincident(type(apart)(**{**vars(apart), "weld": weld}), EQUAL[:24])
    assert found.distinct.sum() == 12
    assert found.has_remaining_copy.sum() == 12
    assert len(found.duplicates) == 0
