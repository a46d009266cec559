import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from core.geometry.grouping import among, first_of_each, float_words, group_rows, ranks, weld, without_copies


@given(words=arrays(np.uint32, st.tuples(st.integers(0, 30), st.integers(1, 4)), elements=st.integers(0, 3)))
def test_rows_get_equal_labels_exactly_when_they_are_equal(words: np.ndarray) -> None:
    labels = group_rows(words)
    same = (words[:, None] == words[None]).all(axis=2)
    np.testing.assert_array_equal(labels[:, None] == labels[None], same)
    assert set(labels) == set(range(len(set(labels))))


def test_negative_zero_is_zero_and_the_next_float_is_another_row() -> None:
    tiny = np.nextafter(np.float32(1), np.float32(2))
    labels = group_rows(float_words(np.array([[0.0, 1], [-0.0, 1], [0, tiny]], np.float32)))
    assert labels[0] == labels[1] != labels[2]


def test_doubles_are_compared_to_their_last_bit() -> None:
    labels = group_rows(float_words(np.array([[1.0], [np.nextafter(1.0, 2)], [1.0]])))
    assert labels[0] == labels[2] != labels[1]


@pytest.mark.parametrize("scale", [1.0, 1 / 3])
def test_equal_rows_share_their_first_one(scale: float) -> None:
    rows = np.array([[1, 2], [0.0, 3], [1, 2], [-0.0, 3], [4, 4]]) * scale
    assert weld(rows).tolist() == [0, 1, 0, 1, 4]


@given(
    values=arrays(np.int64, st.integers(0, 20), elements=st.integers(-3, 9)),
    others=arrays(np.int64, st.integers(0, 20), elements=st.integers(-3, 9)),
)
def test_values_are_among_others_where_one_of_these_equals_them(values: np.ndarray, others: np.ndarray) -> None:
    assert among(values, others).tolist() == [value in others for value in values]


def test_many_values_are_looked_up_as_few_are() -> None:
    others = np.arange(0, 40_000, 2)
    assert among(np.array([3, 39_998, -1, 0, 50_000]), others).tolist() == [False, True, False, True, False]


@given(values=arrays(np.int64, st.integers(0, 20), elements=st.integers(0, 9)), differs=st.integers(0, 2**20 - 1))
def test_equal_numbers_have_one_first_place_and_one_rank(values: np.ndarray, differs: int) -> None:
    first = first_of_each(values)
    assert first.tolist() == [values.tolist().index(value) for value in values.tolist()]
    assert ranks(values).tolist() == [len({other for other in values.tolist() if other < value}) for value in values]
    is_other = np.array([differs >> place & 1 for place in range(len(values))], dtype=bool)
    own, number = without_copies(first, is_other)
    copied = own[number]
    expected = np.where(is_other, np.arange(len(values)), first)
    assert copied.tolist() == expected.tolist()
