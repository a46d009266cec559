from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from core.geometry.boxes import Boxes
from core.gltf.colors import hex_linear
from core.placement.candidates import upright
from core.placement.objective import (
    LUMINANCE,
    OBJECTIVE,
    Objective,
    Placement,
    best_possible_coverage,
    centroid,
    contrast,
    facing,
    likelihood,
    targets,
)
from tests.core.placement.shapes import box, boxes, cuboid, plane, rotation

SERVED = targets(cuboid(30, 30, 30))
FRONT = 0  # the first view


def shown(
    where: Boxes, bent: float = 0.0, contrast: float = 1.0, colored: bool = False
) -> np.ndarray[tuple[int, int], np.dtype[np.float32]]:
    """The likelihood of each box for each column, being seen alone counting for nothing."""
    faced = facing(where, SERVED.directions)
    bends, heights = np.full(len(where), bent), contrast * where.size[:, 1]
    return likelihood(where, faced, bends, heights, SERVED, colored, replace(OBJECTIVE, seen=0.0))


def a_placement(number: int, seed: int) -> Placement:
    rng = np.random.default_rng(seed)
    normal = rng.normal(size=(number, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    found = Boxes(normal * 12, upright(normal), np.tile([4.0, 0.5, 0.4], (number, 1)))
    return Placement(
        found,
        np.zeros(number),
        np.ones(number),
        facing(found, SERVED.directions),
        shown(found),
        rng.random(number) * 0.03,
        np.zeros(number, dtype=bool),
        SERVED.weight,
    )


@settings(max_examples=30)
@given(seed=st.integers(0, 1000), picks=st.lists(st.integers(0, 19), unique=True, min_size=2, max_size=8))
def test_what_a_mark_adds_is_the_difference_it_makes_and_shrinks_as_others_are_there(
    seed: int, picks: list[int]
) -> None:
    placement = a_placement(20, seed)
    one, *others = picks
    few = others[: len(others) // 2]
    to_few, to_others = (float(placement.gain(some, np.array([one]))[0]) for some in (few, others))
    assert to_few == pytest.approx(placement.value([*few, one]) - placement.value(few), abs=1e-5)
    assert to_others == pytest.approx(placement.value([*others, one]) - placement.value(others), abs=1e-5)
    assert to_others <= to_few + 1e-6


@settings(max_examples=30)
@given(seed=st.integers(0, 1000), picks=st.lists(st.integers(0, 19), unique=True, min_size=1, max_size=8))
def test_what_every_mark_adds_where_one_is_left_out_is_what_it_adds_to_the_others(seed: int, picks: list[int]) -> None:
    placement = a_placement(20, seed)
    everyone = np.arange(20)
    without = placement.gain_without(picks, everyone)
    for position, one in enumerate(picks):
        others = [other for other in picks if other != one]
        assert without[:, position] == pytest.approx(placement.gain(others, everyone), abs=1e-6)


def test_nothing_chosen_is_worth_nothing() -> None:
    assert a_placement(5, 0).value([]) == 0


def test_all_views_served_are_worth_one_and_all_crops_as_much_as_stated() -> None:
    assert SERVED.weight[: len(SERVED.directions)].sum() == pytest.approx(1)
    assert SERVED.weight[:24].sum() == pytest.approx(0.5)
    assert len(SERVED.weight) == len(SERVED.directions) + OBJECTIVE.half_spaces


def test_large_upright_text_on_flat_ground_serves_the_view_it_faces() -> None:
    assert shown(box((0, 0, 15), size=(7.5, 0.94, 0.5)))[0, FRONT] == pytest.approx(1)


@pytest.mark.parametrize(
    "worse",
    [
        box((0, 0, 15), size=(2.0, 0.25, 0.25)),
        box((0, 0, 15), size=(7.5, 0.94, 0.5), axes=rotation((0, 0, 1), 40)),
        box((0, 0, 15), size=(7.5, 0.94, 0.5), axes=rotation((0, 1, 0), 44.5)),
    ],
    ids=["small", "rolled", "turned away"],
)
def test_small_rolled_or_turned_text_serves_a_view_less(worse: Boxes) -> None:
    assert 0 < shown(worse)[0, FRONT] < 0.95


def test_bent_text_serves_less_and_hidden_text_not_at_all() -> None:
    where = box((0, 0, 15), size=(7.5, 0.94, 0.5))
    assert shown(where, bent=0.4)[0, FRONT] == pytest.approx(0.6)
    hidden = likelihood(where, np.zeros((1, len(SERVED.directions)), dtype=bool), np.zeros(1), where.size[:, 1], SERVED)
    assert not hidden[0, : len(SERVED.directions)].any()


def test_a_mark_that_is_seen_serves_a_view_however_badly_it_reads() -> None:
    where = box((0, 0, 15), size=(1.2, 0.15, 0.25), axes=rotation((0, 1, 0), 44))
    faced = facing(where, SERVED.directions)
    served = likelihood(where, faced, np.ones(1), where.size[:, 1], SERVED)[0, FRONT]
    assert served == pytest.approx(OBJECTIVE.seen)


def test_text_of_a_colour_of_its_own_serves_at_heights_at_which_plain_text_hardly_does() -> None:
    where = box((0, 0, 15), size=(2.6, 0.33, 0.5))
    assert shown(where, colored=True)[0, FRONT] > 1.2 * shown(where)[0, FRONT]


@pytest.mark.parametrize("colored", [False, True])
def test_no_mark_serves_a_direction_better_than_its_width_can(colored: bool) -> None:
    for width in (7.5, 4.0, 2.0, 1.2):
        where = box((0, 0, 15), size=(width, width / 8, 0.5))
        seen = facing(where, SERVED.directions)
        served = likelihood(where, seen, np.zeros(1), where.size[:, 1], SERVED, colored)[0, : len(SERVED.directions)]
        reach = best_possible_coverage(width / 8, SERVED.directions[:, 2], colored)
        assert (served <= reach + 1e-6).all()
        assert served.max() == pytest.approx(reach.max(), abs=0.01)
        assert served[seen[0]].min() > 0.7 * reach[seen[0]].min()


def test_where_marks_shall_be_prominent_text_that_reads_well_is_worth_less_than_larger_text() -> None:
    strong = replace(OBJECTIVE, prominent=0.8, large=4.0)
    usual, large = (best_possible_coverage(height, np.ones(1), False) for height in (0.6, 2.4))
    assert usual == large == 1
    usual, large = (best_possible_coverage(height, np.ones(1), False, strong) for height in (0.6, 2.4))
    assert 0.6 < usual < 0.8
    assert large == 1


def test_a_view_that_reads_one_mark_gains_from_a_second_but_from_no_third() -> None:
    placement = replace(a_placement(3, 0), likelihood=np.array([[0.9], [0.6], [0.3]], np.float32), weight=np.ones(1))
    placement = replace(placement, cost=np.zeros(3))
    assert placement.value([0]) == pytest.approx(0.9)
    assert placement.value([2, 0]) == pytest.approx(0.9 + 0.3 * OBJECTIVE.redundancy)
    assert placement.value([0, 1]) == pytest.approx(0.9 + 0.6 * OBJECTIVE.redundancy)
    assert placement.value([0, 1, 2]) == placement.value([0, 1])


def crowded(other: Boxes) -> float:
    """What a box pays beside that at the origin."""
    pair = boxes(box((0, 0, 0)), other)
    nothing = np.zeros((2, 1), np.float32)
    placement = replace(a_placement(2, 0), boxes=pair, likelihood=nothing, weight=np.ones(1), cost=np.zeros(2))
    (gain,) = placement.gain([0], np.array([1]))
    assert placement.value([0, 1]) == pytest.approx(gain)
    return float(-gain)


def test_marks_close_together_pay_for_it_and_marks_apart_or_back_to_back_do_not() -> None:
    across = rotation((0, 0, 1), 90)
    assert crowded(box((0, 4, 0), axes=across)) == pytest.approx(0.2 * OBJECTIVE.proximity_weight)
    assert crowded(box((0, 3, 0), axes=across)) > crowded(box((0, 4, 0), axes=across)) > 0
    assert crowded(box((0, 6, 0))) == crowded(box((0, 0, -1), axes=rotation((1, 0, 0), 180))) == 0


def test_lines_in_a_stack_and_lines_off_one_baseline_pay_for_it_as_well() -> None:
    near = OBJECTIVE.proximity_weight
    assert crowded(box((0, 2, 0))) == pytest.approx(0.6 * near + OBJECTIVE.stacked)
    away = 1 - np.hypot(4.5, 0.2) / 5
    assert crowded(box((4.5, 0.2, 0))) == pytest.approx(away * near + OBJECTIVE.ragged, abs=1e-6)
    assert crowded(box((4.5, 0, 0))) == pytest.approx(0.1 * near)


def test_a_range_and_a_weight_of_the_options_decide_how_far_marks_keep_apart() -> None:
    objective = Objective(proximity_weight=0.1, proximity_range=2.0)
    pair = boxes(box((0, 0, 0)), box((0, 1, 0)))
    nothing = np.zeros((2, 1), np.float32)
    placement = replace(a_placement(2, 0), boxes=pair, likelihood=nothing, weight=np.ones(1), cost=np.zeros(2))
    assert replace(placement, objective=objective).value([0, 1]) == pytest.approx(-0.05 - objective.stacked)


def test_letters_of_a_colour_stand_out_from_other_colours_and_letters_without_one_from_bright_ground() -> None:
    grey = np.repeat([[0.0], [0.2], [1.0]], 3, axis=1)
    even = np.zeros(3)
    plain, white, black = (contrast(grey, even, palette) for palette in ((), ("#ffffff",), ("#000000",)))
    assert (np.diff(plain) > 0).all()
    assert plain[2] == white[0] == black[2] == 1
    assert white[2] == black[0] == plain[0] == pytest.approx(0.5)


def test_letters_stand_out_from_ground_of_the_same_lightness_and_another_hue() -> None:
    red = hex_linear("#d02020")
    ground = np.array([red, np.full(3, LUMINANCE @ red), hex_linear("#b83024")])
    same, grey, brick = contrast(ground, np.zeros(3), ("#d02020",))
    assert same == pytest.approx(0.5)
    assert grey == 1
    assert same < brick < 0.75


def test_a_varied_texture_hides_letters_without_a_colour_and_hardly_those_with_one() -> None:
    white, busy = np.ones((3, 3)), np.array([0.0, OBJECTIVE.masking, 1.0])
    plain = contrast(white, busy, ())
    assert plain[:2] == pytest.approx([1, np.sqrt(0.5)])
    assert plain[2] < 0.5
    assert (contrast(white, busy, ("#000000",)) == 1).all()


def test_text_is_read_worse_where_its_tone_is_that_of_the_ground() -> None:
    where = box((0, 0, 15), size=(4, 0.5, 0.5))
    assert shown(where, contrast=0.5)[0, FRONT] < 0.8 * shown(where)[0, FRONT]
    larger = box((0, 0, 15), size=(8, 1, 0.6))
    assert shown(larger, contrast=0.5)[0, FRONT] == pytest.approx(shown(where)[0, FRONT])


def test_upside_down_text_is_worth_half_of_upright_text() -> None:
    upright_, turned = shown(
        boxes(box((0, 0, 15), (7.5, 0.94, 0.5)), box((0, 0, 15), (7.5, 0.94, 0.5), rotation((0, 0, 1), 180)))
    )
    assert turned[FRONT] == pytest.approx(upright_[FRONT] / 2)


def test_a_mark_survives_the_crops_that_keep_all_of_it() -> None:
    whole = shown(box((0, 0, 15), size=(7.5, 0.94, 0.5)))[0, len(SERVED.directions) :]
    keeps = SERVED.half_spaces[:, 2] > 0.3
    assert whole[keeps].all()
    assert not whole[SERVED.half_spaces[:, 2] < 0].any()


def test_two_marks_on_opposite_sides_survive_nearly_every_crop_and_two_on_one_side_do_not() -> None:
    left, right, beside = (
        shown(box(at, size=(2, 0.25, 0.25)))[0, 224:] for at in ((0, 0, 15), (0, 0, -15), (3, 0, 15))
    )
    assert np.maximum(left, right).mean() > 0.9
    assert np.maximum(left, beside).mean() < 0.65


def test_the_centroid_is_that_of_the_area_not_of_the_vertices() -> None:
    assert np.allclose(centroid(plane(10, 4, cells=3)), 0)


def test_rows_of_pairs_are_worth_less_than_marks_that_look_apart() -> None:
    placement = a_placement(40, 3)
    closest = max(
        combinations(range(40), 2), key=lambda p: placement.boxes.axes[p[0], 2] @ placement.boxes.axes[p[1], 2]
    )
    one, other = closest
    furthest = int((placement.boxes.axes[:, 2] @ placement.boxes.axes[one, 2]).argmin())
    pair = placement.value([one, other]) + placement.cost[other]
    apart = placement.value([one, furthest]) + placement.cost[furthest]
    assert apart > pair
