import numpy as np
import pytest

from core.analysis.saliency import saliency
from core.metrics.se import se
from tests.core.analysis.test_saliency import hand_made
from tests.core.metrics.test_ray import on_all_sides
from tests.core.placement.shapes import box, boxes, cuboid, join, moved, sphere


def test_marks_votes_are_averaged_and_a_mark_on_mostly_salient_surface_votes_one() -> None:
    marks = boxes(
        box((5, 0, 0), (4, 4, 1)), box((-5, 0, 0), (4, 4, 1)), box((-4, 0, 0), (8, 4, 1)), box((1, 0, 0), (8, 4, 1))
    )
    error, mean = se(hand_made(), marks)
    assert error == 0.5
    assert mean.tolist() == pytest.approx([0.8, 0.2, 0.2, (5 * 0.8 + 3 * 0.2) / 8])


def test_half_salient_is_no_vote_yet() -> None:
    assert se(hand_made(), box((0, 0, 0), (8, 4, 1)))[0] == 0


def test_marks_on_the_faces_of_a_block_are_no_error() -> None:
    error, mean = se(saliency(cuboid(10, 10, 10), seed=0), on_all_sides())
    assert error == 0
    assert mean.max() < 0.05


def test_without_marks_there_is_no_error() -> None:
    error, mean = se(hand_made(), box()[np.empty(0, dtype=np.int64)])
    assert error == 0
    assert len(mean) == 0


def test_a_mark_on_a_knob_is_an_error_and_one_along_a_straight_edge_is_none() -> None:
    slanted = np.array([[1.0, 0, 0], [0, np.sqrt(0.5), -np.sqrt(0.5)], [0, np.sqrt(0.5), np.sqrt(0.5)]])
    marks = boxes(box((0, 0, 6), (1.6, 0.6, 0.5)), box((0, 5, 5), (4, 0.6, 0.7), axes=slanted))
    shape = join(cuboid(10, 10, 10), moved(sphere(1), shift=(0, 0, 5)))
    error, mean = se(saliency(shape, seed=0), marks)
    assert error == 0.5
    assert mean[1] < 0.05 < 0.5 < mean[0]
