from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core.geometry.boxes import Boxes
from core.geometry.directions import fibonacci_directions
from core.placement.candidates import upright
from core.placement.filters import overlapping
from core.placement.objective import Placement, facing, likelihood, targets
from core.placement.selection import SelectionOptions, select, visibility
from tests.core.placement.shapes import box, boxes, index_of, inside_out, join, moved, plane, rotation, sphere

SERVED = targets(sphere(12))


def on_a_ball(number: int, seed: int = 0, radius: float = 12.0) -> Placement:
    """Boxes at random places on a ball, seen from wherever they face."""
    rng = np.random.default_rng(seed)
    normal = rng.normal(size=(number, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    found = Boxes(normal * radius, upright(normal), np.tile([4.0, 0.5, 0.4], (number, 1)))
    visible = facing(found, SERVED.directions)
    return Placement(
        boxes=found,
        loss=np.zeros(number),
        roughness=np.ones(number),
        visible=visible,
        likelihood=likelihood(found, visible, np.zeros(number), found.size[:, 1], SERVED),
        cost=0.005 + 0.02 * rng.random(number),
        last_resort=np.zeros(number, dtype=bool),
        weight=SERVED.weight,
    )


def seen(placement: Placement, chosen: list[int]) -> float:
    return float(placement.visible[chosen].any(axis=0).mean())


@settings(max_examples=25)
@given(
    number=st.integers(0, 120),
    seed=st.integers(0, 100),
    count=st.integers(1, 20),
    picks=st.lists(st.integers(0, 119), max_size=4),
)
def test_a_selection_never_overlaps_never_exceeds_the_count_and_keeps_what_is_fixed(
    number: int, seed: int, count: int, picks: list[int]
) -> None:
    placement = on_a_ball(number, seed)
    earlier = select(placement, min(3, count))
    fixed = earlier[:2]
    rejected = {pick for pick in picks if pick < number and pick not in fixed}
    chosen = select(placement, count, fixed=fixed, rejected=rejected)
    assert chosen[: len(fixed)] == fixed
    assert len(chosen) == len(set(chosen)) <= count
    assert not rejected & set(chosen)
    for position, one in enumerate(chosen):
        assert not overlapping(placement.boxes, one)[chosen[position + 1 :]].any()


def test_nothing_to_choose_from_chooses_nothing() -> None:
    assert select(on_a_ball(0), 10) == []


def test_marks_spread_over_all_octants_of_a_ball() -> None:
    placement = on_a_ball(400)
    centers = placement.boxes.center[select(placement, 16)]
    assert len({tuple(octant) for octant in (centers > 0).tolist()}) == 8


def test_no_more_marks_are_placed_than_add_something() -> None:
    assert len(select(on_a_ball(600), 64)) < 20


@settings(max_examples=25)
@given(seed=st.integers(0, 100), number=st.integers(1, 60), more=st.integers(0, 60), count=st.integers(1, 12))
def test_more_candidates_never_make_the_choice_worse(seed: int, number: int, more: int, count: int) -> None:
    placement = on_a_ball(number + more, seed)
    few = select(placement, count, rejected=range(number, number + more))
    assert placement.value(select(placement, count, start=few)) >= placement.value(few)


@settings(max_examples=15)
@given(seed=st.integers(0, 100))
def test_the_choice_is_better_than_the_best_of_many_random_ones(seed: int) -> None:
    placement = on_a_ball(200, seed)
    rng = np.random.default_rng(seed)
    chosen = placement.value(select(placement, 8))
    assert chosen > max(placement.value(rng.choice(200, 8, replace=False).tolist()) for _ in range(100))


def test_an_asset_on_which_no_place_is_worth_its_cost_still_gets_its_best_mark() -> None:
    placement = replace(on_a_ball(30), cost=np.linspace(2, 3, 30))
    chosen = select(placement, 10)
    assert len(chosen) == 1
    assert placement.value(chosen) == max(placement.value([one]) for one in range(30))


def test_enough_marks_are_seen_from_all_24_views() -> None:
    placement = on_a_ball(600)
    chosen = select(placement, 16)
    assert placement.visible[chosen][:, :24].any(axis=0).all()
    assert seen(placement, chosen) > 0.97


def test_a_few_marks_go_where_they_are_seen_from_most_directions() -> None:
    placement = on_a_ball(400)
    best_three = select(placement, 3)
    rng = np.random.default_rng(0)
    random = max(seen(placement, rng.choice(400, 3, replace=False).tolist()) for _ in range(50))
    assert len(best_three) == 3
    assert seen(placement, best_three) >= random


def test_a_box_that_failed_is_replaced_while_the_embossed_ones_stay() -> None:
    placement = on_a_ball(400)
    first = select(placement, 10)
    again = select(placement, 10, fixed=first[:4], rejected={first[4]})
    assert again[:4] == first[:4]
    assert first[4] not in again
    assert len(again) >= len(first) - 1
    assert seen(placement, again) > 0.9 * seen(placement, first)


def test_of_two_places_with_the_same_view_the_cheaper_is_taken() -> None:
    pair = boxes(box((0, 0, 0)), box((0, 5, 0)))
    placement = Placement(
        pair,
        np.zeros(2),
        np.ones(2),
        np.ones((2, 1), dtype=bool),
        np.ones((2, 1), dtype=np.float32),
        np.array([0.9, 0.1]),
        np.zeros(2, dtype=bool),
        np.ones(1),
    )
    assert select(placement, 4) == [1]


def test_the_same_placement_gives_the_same_selection() -> None:
    assert select(on_a_ball(300, 5), 12) == select(on_a_ball(300, 5), 12)


def test_a_mark_faces_a_view_within_45_degrees() -> None:
    turned = boxes(box(axes=rotation((0, 1, 0), 44)), box(axes=rotation((0, 1, 0), 46)))
    # Rows of the axes matrix are turned the other way round than columns; both signs face alike.
    assert facing(turned, np.array([[0.0, 0, 1]]))[:, 0].tolist() == [True, False]


@pytest.mark.parametrize(("direction", "expected"), [((0, 0, 1), False), ((0.6, 0, 0.8), True), ((1, 0, 0), False)])
def test_a_mark_is_visible_where_all_its_rays_pass_the_asset(
    direction: tuple[float, float, float], expected: bool
) -> None:
    wall = moved(inside_out(plane(3, 3)), shift=(0, 0, 6))
    shape = join(plane(20, 20), wall)
    points = np.array([[[-1.0, 0, 0.1], [1.0, 0, 0.1]]])
    assert visibility(box(), points, index_of(shape), np.array([direction], dtype=float))[0, 0] == expected


def test_a_mark_on_the_inside_of_a_hollow_is_visible_from_nowhere() -> None:
    shape = inside_out(sphere(8))
    inner = box((0, 0, -8))
    points = np.array([[[0.0, 0, -7.8]]])
    assert not visibility(inner, points, index_of(shape), fibonacci_directions(50)).any()


def test_marks_keep_as_far_apart_as_the_options_say() -> None:
    placement = on_a_ball(200)
    for spacing in (0.3, 5.0):
        chosen = select(placement, 16, options=SelectionOptions(spacing=spacing))
        assert len(chosen) > 2
        for position, one in enumerate(chosen):
            assert not overlapping(placement.boxes, one, spacing)[chosen[position + 1 :]].any()
