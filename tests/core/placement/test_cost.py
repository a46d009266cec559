from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.placement.cost import Terms, cost, curvature_deviation, distance, obstructed, prices, roll
from core.placement.objective import OBJECTIVE, facing, targets
from tests.core.placement.shapes import box, cuboid, rotation

SERVED = targets(cuboid(30, 30, 30))


def terms(**given: float) -> Terms:
    return Terms(**{one.name: np.array([given.get(one.name, 0.0)]) for one in fields(Terms)})


@pytest.mark.parametrize(
    "name",
    [
        *("obstructed", "salient", "roll", "curvature_deviation", "rough", "edge_proximity", "folded", "articulation"),
        *("detail", "busy", "face", "feature", "last_resort", "distance"),
    ],
)
def test_everything_unwelcome_costs(name: str) -> None:
    assert cost(terms(**{name: 0.5})) > cost(terms())


def test_preferred_places_cost_less_and_every_mark_costs_something() -> None:
    assert cost(terms(preferred=1.0)) < cost(terms())
    assert cost(terms()) > 0


@given(st.lists(st.floats(0, 2), min_size=len(fields(Terms)), max_size=len(fields(Terms))))
def test_the_prices_of_all_terms_are_the_cost(values: list[float]) -> None:
    given_terms = terms(**dict(zip([one.name for one in fields(Terms)], values, strict=True)))
    told = prices(given_terms)
    assert sum(float(value[0]) for value in told.values()) == pytest.approx(float(cost(given_terms)[0]), abs=1e-12)
    assert told.keys() == {*(one.name for one in fields(Terms)), "mark"}


def test_a_mark_on_a_salient_part_has_to_show_what_no_other_does() -> None:
    view = SERVED.weight[0] * OBJECTIVE.seen
    assert view < cost(terms(last_resort=1.0))[0] < 4 * view


def test_the_obstructed_share_is_that_of_the_directions_a_mark_faces() -> None:
    where = box((0, 0, 15))
    faced = facing(where, SERVED.directions)
    assert obstructed(faced, faced, SERVED) == pytest.approx(0)
    assert obstructed(np.zeros_like(faced), faced, SERVED) == pytest.approx(1)


@given(degrees=st.floats(0, 90))
def test_roll_is_the_sine_of_the_turn_from_upright(degrees: float) -> None:
    assert roll(box(axes=rotation((0, 0, 1), degrees)))[0] == pytest.approx(np.sin(np.radians(degrees)), abs=1e-6)


def test_bend_is_the_part_of_the_boxs_thickness_that_the_surface_takes_up() -> None:
    where = box(size=(4, 1, 0.5))
    assert curvature_deviation(where, np.array([[0.1, -0.1]]))[0] == pytest.approx(0.4)
    assert curvature_deviation(where, np.array([[-np.inf, 0.0]]))[0] == 1


def test_a_mark_changes_a_small_surface_more() -> None:
    relief, ink = np.array([0.2]), np.array([0.4])
    assert distance(box(), relief, ink, 100.0) == pytest.approx(10 * distance(box(), relief, ink, 1000.0))
