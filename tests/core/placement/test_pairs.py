import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from core.geometry.boxes import Boxes
from core.placement.candidates import upright
from core.placement.pairs import proximity, ragged, stacked
from tests.core.placement.shapes import box, boxes, rotation

HERE = box((0, 0, 0), size=(4, 0.5, 0.5))


def beside(x: float, y: float, degrees: float = 0.0, height: float = 0.5) -> Boxes:
    return box((x, y, 0), size=(8 * height, height, 0.5), axes=rotation((0, 0, 1), degrees))


def test_lines_above_each_other_are_a_stack() -> None:
    assert stacked(HERE, beside(0, 1)).all()
    assert stacked(HERE, beside(2.5, 1.5)).all(), "shifted, but one over the other"
    assert not stacked(HERE, beside(0, 2.5)).any(), "far above"
    assert not stacked(HERE, beside(5, 1)).any(), "beside it"
    assert not stacked(HERE, beside(0, 1.5, degrees=30)).any(), "no line of one block"
    assert not stacked(HERE, box((0, 1, 0), axes=rotation((1, 0, 0), 40))).any(), "on another face"
    assert not stacked(HERE, box((0, 1, 3), size=(4, 0.5, 0.5))).any(), "on a step"


def test_words_beside_each_other_stand_on_one_baseline_or_are_ragged() -> None:
    assert not ragged(HERE, beside(5, 0)).any()
    assert ragged(HERE, beside(5, 0.2)).all()
    assert ragged(HERE, beside(5, 0, degrees=5)).all()
    assert not ragged(HERE, beside(7, 0.25, height=1.0)).any(), "higher letters on the same baseline"
    assert ragged(HERE, beside(7, 0, height=1.0)).all()
    assert not ragged(HERE, beside(9, 0.2)).any(), "too far for anybody to compare"
    assert not ragged(HERE, beside(5, 0.8)).any(), "a line of its own"


@given(seed=st.integers(0, 1000))
def test_a_pair_is_the_same_pair_from_either_side(seed: int) -> None:
    rng = np.random.default_rng(seed)
    normal = rng.normal(size=(12, 3)) * 0.2 + (0, 0, 1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    some = Boxes(rng.random((12, 3)) * 4, upright(normal), np.tile([4.0, 0.5, 0.4], (12, 1)))
    for relation in (stacked, ragged):
        table = relation(some, some)
        assert (table == table.T).all()
        assert not (stacked(some, some) & ragged(some, some)).any()
    near = proximity(some, some, 5.0)
    assert np.allclose(near, near.T)
    assert np.allclose(np.diag(near), 1)


def test_there_may_be_no_marks_to_compare_with() -> None:
    for relation in (stacked, ragged):
        assert relation(boxes(HERE, HERE), Boxes.empty()).shape == (2, 0)
