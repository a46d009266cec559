"""Readings of one place are together, and others are not."""

import numpy as np

from core.verify.places import places
from core.verify.readings import Reading, Spot


def reading(
    x: float, normal: tuple[float, float, float] = (0, 0, 1), text: str = "mark", confidence: float = 0.9
) -> Reading:
    return Reading(
        text=text,
        confidence=confidence,
        kind="ordinary",
        look=0,
        spot=Spot(
            row=0.0,
            center=np.array([x, 0, 0]),
            right=np.array([1.0, 0, 0]),
            normal=np.array(normal, dtype=np.float64),
            length=4.0,
            height=0.5,
        ),
    )


def test_where_nothing_is_read_there_is_no_place() -> None:
    assert places([]) == []


def test_readings_near_each_other_are_of_one_place() -> None:
    found = places([reading(0), reading(0.5), reading(10), reading(10.5, text="another")])
    assert sorted(len(place.readings) for place in found) == [2, 2]


def test_readings_on_the_two_sides_of_a_wall_are_of_two_places() -> None:
    assert len(places([reading(0), reading(0, (0, 0, -1))])) == 2


def test_a_place_is_where_the_surest_of_its_readings_is() -> None:
    [place] = places([reading(0, confidence=0.3), reading(0.5, confidence=0.9), reading(0.2, text="m", confidence=1)])
    assert place.spot.center[0] == 0.5
    np.testing.assert_allclose(place.spot.up, [0, 1, 0])
