import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core.geometry.boxes import Boxes
from core.metrics.wps_area import wps_area
from tests.core.placement.shapes import box, boxes, inside_out, join, moved, plane, rotation, sphere


@pytest.mark.parametrize("cells", [1, 2, 7, 30])
def test_a_surface_through_the_whole_box_scores_one_however_coarse(cells: int) -> None:
    assert wps_area(plane(10, 10, cells), box((0.3, 0.1, 0)))[0] == pytest.approx(1)


def test_a_box_half_over_an_edge_scores_one_half() -> None:
    assert wps_area(plane(10, 10), box((5, 0, 0)))[0] == pytest.approx(0.5)
    assert wps_area(plane(10, 10, 9), box((5, 5, 0)))[0] == pytest.approx(0.25)


@given(x=st.floats(-4, 4), y=st.floats(-4, 4))
def test_the_score_is_the_share_of_the_front_over_the_surface(x: float, y: float) -> None:
    expected = max(0, min(1, x + 2) - max(-1, x - 2)) * max(0, min(1, y + 0.5) - max(-1, y - 0.5)) / 4
    assert wps_area(plane(2, 2), box((x, y, 0)))[0] == pytest.approx(expected, abs=1e-9)


def test_surface_above_or_below_the_box_does_not_count() -> None:
    shape = plane(10, 10)
    assert wps_area(shape, boxes(box((0, 0, 0.2)), box((0, 0, 0.3)), box((0, 0, -0.3)))).tolist() == pytest.approx(
        [1, 0, 0]
    )


def test_a_slope_counts_where_it_is_within_the_thickness() -> None:
    # Rising 45 degrees along x, it is inside a box of thickness 0.5 over half a unit of its four.
    slope = moved(plane(20, 20), rotation((0, 1, 0), -45))
    assert wps_area(slope, box())[0] == pytest.approx(0.5 / 4)


def test_faces_that_look_away_count_nothing_and_layers_count_once() -> None:
    assert wps_area(inside_out(plane(10, 10)), box())[0] == 0
    assert wps_area(join(plane(10, 10), moved(plane(10, 10), shift=(0, 0, 0.1))), box())[0] == 1


@settings(max_examples=10)
@given(degrees=st.floats(0, 360), axis=st.sampled_from([(1, 0, 0), (0, 1, 0), (2, 1, 3)]))
def test_the_score_moves_with_the_asset(degrees: float, axis: tuple[float, float, float]) -> None:
    shape, here, turn = sphere(6, rings=10), box((0, 0, 5.7), (5, 2, 0.5)), rotation(axis, degrees)
    there = Boxes(here.center @ turn.T + 2, here.axes @ turn.T, here.size)
    score = wps_area(shape, here)[0]
    assert 0 < score < 1
    assert wps_area(moved(shape, turn, np.array([2, 2, 2])), there)[0] == pytest.approx(score, abs=1e-6)


def test_a_box_far_from_everything_scores_nothing() -> None:
    assert wps_area(plane(1, 1), box((50, 0, 0)))[0] == 0
