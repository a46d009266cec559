from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from core.analysis.facts import SurfaceFacts
from core.analysis.features import FeatureRegions
from core.analysis.saliency import saliency
from core.choices import Mode, Preset, Strength
from core.errors import ErrorCode, MeshmarkError
from core.formats.admission import admit, document_of
from core.geometry.surface import Surface
from core.gltf.scene import flatten
from core.parameters import NO_COLOR, Parameters
from core.placement.candidates import upright
from core.placement.context import PlacementContext, build_context
from core.placement.filters import overlapping
from core.placement.legibility import legible_height
from core.placement.objective import Placement
from core.placement.options import SEARCH, SearchOptions
from core.placement.place import ladder, place, search_again, up_to
from core.placement.selection import select
from tests.core.formats.meshes import MESHES
from tests.core.placement.shapes import carrier, cuboid, inside_out, join, layouts, moved, plane, sphere, surface

ASPECT = 0.125
WIDTHS = ladder(ASPECT)
LEGIBLE_WIDTH = WIDTHS[len(SEARCH.heights) - 1]


def opened(
    shape: Surface, rng: np.random.Generator, aspect: float = ASPECT, lines: int = 1, **asked: object
) -> PlacementContext:
    parameters = Parameters.model_validate({"text": "watermark"} | asked).resolved()
    salient = saliency(shape, parameters.seed)
    return build_context(carrier(shape), SurfaceFacts(salient), layouts(aspect, lines=lines), parameters, rng)


def placed(shape: Surface, aspect: float = ASPECT, lines: int = 1, seed: int = 0, **asked: object) -> Placement:
    rng = np.random.default_rng(seed)
    return place(opened(shape, rng, aspect, lines, seed=seed, **asked), rng)


def lines_of(found: Placement, aspect: float, lines: int) -> set[int]:
    """Numbers of lines of the chosen marks."""
    return set((1 + layouts(aspect, lines=lines).of(found.boxes.size[list(found.start)])).tolist())


def progress(shape: Surface, **asked: Any) -> list[float]:
    """What placement says of its progress."""
    shares: list[float] = []
    rng = np.random.default_rng(0)
    place(opened(shape, rng, **asked), rng, shares.append)
    return shares


def test_a_cube_of_twelve_faces_is_marked_on_every_side() -> None:
    found = placed(cuboid(30, 30, 30))
    chosen = list(found.start)
    normals = found.boxes.axes[chosen, 2]
    assert {tuple(side) for side in np.round(normals).astype(int).tolist()} == {
        (1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)
    }  # fmt: skip
    assert found.visible[chosen][:, :24].any(axis=0).all()
    assert np.all(found.boxes.size[chosen, 0] == WIDTHS[0])


def test_boxes_lie_on_the_surface_and_look_outwards() -> None:
    found = placed(sphere(15), size=3.0)
    outward = found.boxes.center / np.linalg.norm(found.boxes.center, axis=1, keepdims=True)
    assert np.einsum("bi,bi->b", outward, found.boxes.axes[:, 2]).min() > 0.98
    assert np.abs(np.linalg.norm(found.boxes.center, axis=1) - 15).max() < 0.2
    assert (found.loss < 0.005).all()
    assert (found.roughness < 1.25).all()


def test_the_same_seed_gives_the_same_placement_and_another_seed_another() -> None:
    one, two, other = (placed(cuboid(30, 20, 10), seed=seed) for seed in (3, 3, 4))
    assert np.array_equal(one.boxes.center, two.boxes.center)
    assert np.array_equal(one.cost, two.cost)
    assert len(one.boxes) != len(other.boxes) or not np.array_equal(one.boxes.center, other.boxes.center)


@pytest.mark.parametrize("count", [1, 2])
def test_where_all_marks_have_their_places_narrower_text_is_not_looked_for(count: int) -> None:
    *searched, done = progress(cuboid(30, 30, 30), count=count)
    assert max(searched) <= 3 / (len(WIDTHS) + SEARCH.rounds - 1)
    assert done == 1
    assert np.all(placed(cuboid(30, 30, 30), count=count).boxes.size[:, 0] >= WIDTHS[1])


def test_what_one_search_finds_nothing_for_is_searched_again() -> None:
    shift = np.random.default_rng(5).uniform(-13, 13, (40, 2))
    needles = [moved(cuboid(0.3, 3, 0.3), shift=(x, 1.6, z)) for x, z in shift]
    corners = [moved(cuboid(1.4, 0.4, 1.4), shift=(side, 0.3, side)) for side in (-14.2, 14.2)]
    shape = join(cuboid(30, 0.2, 30), *needles, *corners)

    def value(seed: int, rounds: int) -> float:
        rng = np.random.default_rng(seed)
        context = opened(shape, rng, seed=seed)
        few = replace(context.options.candidates, number=60)
        search = replace(context.options.search, rounds=rounds)
        found = place(replace(context, options=replace(context.options, search=search, candidates=few)), rng)
        return found.value(found.start)

    assert all(value(seed, SEARCH.rounds) > value(seed, 1) for seed in range(3))


def test_strong_marks_are_larger_than_usual_ones_and_discreet_ones_smaller_and_fewer() -> None:
    widest = {}
    for strength in Strength:
        found = placed(cuboid(30, 30, 30), strength=strength)
        widest[strength] = found.boxes.size[list(found.start), 0].max()
    assert widest[Strength.DISCREET] < widest[Strength.STANDARD] < widest[Strength.STRONG] <= 14
    assert widest[Strength.DISCREET] <= WIDTHS[3]
    assert widest[Strength.STRONG] > 1.5 * WIDTHS[0]


def test_a_size_that_is_asked_for_exactly_is_the_only_one_used() -> None:
    found = placed(cuboid(30, 30, 30), aspect=0.25, size=7.0, size_exact=True)
    assert np.all(found.boxes.size[:, 0] == 7.0)
    assert np.all(found.boxes.size[:, 1] == 1.75)


@pytest.mark.parametrize(("size", "strength"), [(3.0, "standard"), (10.0, "standard"), (20.0, "strong")])
def test_a_size_that_is_asked_for_is_the_widest_and_narrower_text_stands_where_it_does_not_fit(
    size: float, strength: str
) -> None:
    room = join(cuboid(30, 14, 2), moved(cuboid(2.2, 12, 2.2), shift=(0, 13, 0)))
    found = placed(room, size=size, strength=strength)
    widths = found.boxes.size[list(found.start), 0]
    assert widths.max() == pytest.approx(size)
    assert widths.min() < size


def test_the_widths_below_the_one_that_is_asked_for_are_the_usual_ones() -> None:
    assert up_to(None, WIDTHS) == WIDTHS
    assert up_to(WIDTHS[1], WIDTHS) == WIDTHS[1:]
    between = (WIDTHS[1] + WIDTHS[2]) / 2
    assert up_to(between, WIDTHS) == [between, *WIDTHS[2:]]
    wide = up_to(20.0, WIDTHS)
    assert wide[0] == 20.0
    assert wide[-len(WIDTHS) :] == WIDTHS
    assert all(narrow < width <= 1.51 * narrow for width, narrow in pairwise(wide[: -len(WIDTHS) + 1]))


def test_parts_too_narrow_for_wide_text_get_narrower_text() -> None:
    found = placed(join(cuboid(30, 0.8, 0.8), moved(cuboid(3.2, 12, 3.2), shift=(0, 0.4, 0))))
    widths = found.boxes.size[list(found.start), 0]
    assert len(set(widths.tolist())) > 1
    assert widths.min() >= LEGIBLE_WIDTH
    assert widths.max() < WIDTHS[0]


def test_text_as_large_as_a_side_stands_on_both_sides_when_it_is_asked_for() -> None:
    found = placed(cuboid(30, 14, 2), size=20.0, size_exact=True)
    assert sorted(np.round(found.boxes.axes[list(found.start), 2, 2]).tolist()) == [-1, 1]


def highest(found: Placement) -> float:
    return float(found.boxes.size[list(found.start), 1].max())


def test_long_text_is_as_high_as_a_word_and_short_text_higher_but_not_a_tower() -> None:
    cube = cuboid(30, 30, 30)
    word, initials, letter = (highest(placed(cube, aspect=aspect)) for aspect in (ASPECT, 0.5, 4.0))
    long = highest(placed(cube, aspect=0.03125))
    assert long == pytest.approx(word)
    assert initials == letter == pytest.approx(2 * word)


def test_sixty_letters_are_legible_where_there_is_room_and_smaller_where_there_is_none() -> None:
    assert highest(placed(cuboid(30, 30, 30), aspect=0.015)) >= legible_height() * (1 - 1e-9)
    assert 0.05 < highest(placed(cuboid(10, 10, 10), aspect=0.015)) < legible_height()


def test_long_text_runs_along_a_bar_on_which_it_would_not_be_legible_across() -> None:
    assert highest(placed(cuboid(4, 30, 4), aspect=0.015)) >= legible_height() * (1 - 1e-9)


def test_a_long_text_has_fewer_lines_on_narrow_places_and_is_higher_for_it_on_wide_ones() -> None:
    bar, kinds = placed(cuboid(30, 1.6, 1.6), aspect=0.03, lines=4, color=NO_COLOR, seed=1), layouts(0.03, lines=4)
    boxes = bar.boxes[np.array(bar.start)]
    assert kinds.of(boxes.size)[np.abs(boxes.axes[:, 2, 0]) < 0.1].max() <= 1, "but for its ends, which are square"
    plate = placed(cuboid(12, 12, 1), aspect=0.03, lines=4, color=NO_COLOR, seed=3)
    boxes = plate.boxes[np.array(plate.start)]
    on_face, count = np.abs(boxes.axes[:, 2, 2]) > 0.9, 1 + kinds.of(boxes.size)
    assert count[on_face].min() >= 3 > count[~on_face].max()
    assert kinds.line_height(boxes.size).max() > 2 * highest(placed(cuboid(12, 12, 1), aspect=0.03))


def test_text_of_a_width_that_was_asked_for_has_that_width_in_every_layout() -> None:
    found = placed(cuboid(30, 30, 30), aspect=0.03, lines=4, size=6.0, size_exact=True, color=NO_COLOR)
    assert np.allclose(found.boxes.size[:, 0], 6.0)
    lines = 1 + layouts(0.03, lines=4).of(found.boxes.size[list(found.start)])
    assert np.median(lines) >= 3, "whose lines are higher"


def test_the_widths_of_any_proportions_go_down_to_those_of_a_word_in_area() -> None:
    for aspect in (0.001, 0.015, 0.03125, 0.125, 0.5, 4.0):
        widths = ladder(aspect)
        assert widths == sorted(widths, reverse=True)
        assert widths[0] <= 30
        assert widths[-1] ** 2 * aspect <= 2.25 * WIDTHS[-1] ** 2 * ASPECT * 4


def test_no_width_is_below_that_in_which_a_code_can_be_read() -> None:
    least = 0.7 * LEGIBLE_WIDTH
    assert ladder(ASPECT, least=least) == [*(width for width in WIDTHS if width > least), least]
    assert ladder(ASPECT, least=1.5 * WIDTHS[0]) == [1.5 * WIDTHS[0]]
    assert ladder(ASPECT, least=WIDTHS[-1] / 2) == WIDTHS


def test_the_heights_of_the_options_are_the_first_widths() -> None:
    assert ladder(ASPECT, SearchOptions(heights=(2.0,)))[0] == pytest.approx(2.0 * legible_height() / ASPECT)


def test_the_paper_preset_uses_its_samples_and_its_size() -> None:
    found = placed(cuboid(30, 30, 30), preset=Preset.PAPER)
    assert 0 < len(found.boxes) <= 300
    assert np.all(found.boxes.size[:, 0] == 5.5)
    assert np.all(found.boxes.size[:, 2] == 0.5)
    assert found.loss.max() < 0.005


def test_text_follows_a_body_round_as_far_as_it_stays_readable() -> None:
    head = sphere(7)
    assert len(placed(head, size=4.8, size_exact=True).boxes) > 0
    with pytest.raises(MeshmarkError) as caught:
        placed(head, size=8.0, size_exact=True)
    assert "bends away" in caught.value.message


def test_both_sides_of_an_open_sheet_are_told_apart() -> None:
    found = placed(plane(30, 30))
    assert len(found.boxes) > 0
    assert np.allclose(found.boxes.axes[:, 2], (0, 0, 1), atol=1e-6)


@pytest.mark.parametrize("thickness", [0.02, 0.003])
def test_letters_are_not_sunk_into_a_wall_thinner_than_they_are_deep(thickness: float) -> None:
    sheet = cuboid(30, 30, thickness)
    assert len(placed(sheet, mode=Mode.EMBOSS).boxes) > 0
    with pytest.raises(MeshmarkError) as caught:
        placed(sheet, mode=Mode.DEBOSS)
    assert caught.value.code is ErrorCode.NO_PLACEMENT
    assert "so thin that sunken letters would come through" in caught.value.message
    assert "raised letters" in caught.value.remedy
    assert "size" not in caught.value.remedy


def test_an_asset_without_room_says_how_many_places_were_tried_and_what_was_wrong_with_them() -> None:
    with pytest.raises(MeshmarkError) as caught:
        placed(cuboid(30, 0.1, 0.1), size=5.5, size_exact=True)
    assert caught.value.code is ErrorCode.NO_PLACEMENT
    assert "boxes of width 5.5 were tried" in caught.value.message
    assert "ends under it" in caught.value.message
    assert "below 5.5" in caught.value.remedy


def test_an_asset_turned_inside_out_says_so() -> None:
    with pytest.raises(MeshmarkError) as caught:
        placed(inside_out(cuboid(30, 30, 30)))
    assert caught.value.code is ErrorCode.NO_PLACEMENT
    assert "inwards" in caught.value.message
    assert "normals" in caught.value.remedy


def test_progress_rises_to_one() -> None:
    shares = progress(cuboid(30, 30, 30), size=2.0)
    assert shares == sorted(shares)
    assert shares[-1] == 1.0


def test_the_slow_solver_reports_its_progress_as_it_goes() -> None:
    shares = progress(cuboid(10, 6, 6), preset=Preset.PAPER)
    assert len(shares) > 3
    assert shares == sorted(shares)


REAL = ["elephant-paper.obj", "shark-paper.obj", "suzanne.obj", "human-smpl.obj", "fox.glb", "adis16480-metres.stl"]


@pytest.mark.parametrize("path", [MESHES / name for name in REAL if (MESHES / name).exists()], ids=lambda p: p.stem)
def test_real_assets_get_marks_that_are_seen_from_nearly_everywhere(path: Path) -> None:
    data = path.read_bytes()
    found = placed(flatten(document_of(admit(data))).surface)
    chosen = list(found.start)
    assert 8 <= len(chosen) <= 16
    assert found.visible[chosen].any(axis=0).mean() > 0.9
    assert not found.last_resort[chosen].any()
    for position, one in enumerate(chosen):
        assert not overlapping(found.boxes, one)[chosen[position + 1 :]].any()


def test_the_thin_edge_of_a_plate_gets_the_small_text_it_has_room_for() -> None:
    found = placed(cuboid(30, 0.3, 30))
    chosen = list(found.start)
    edge = np.abs(found.boxes.axes[chosen, 2, 1]) < 0.5
    assert edge.any()
    assert found.boxes.size[chosen, 0][edge].max() < 2.5
    assert found.boxes.size[chosen, 0][~edge].max() == WIDTHS[0]
    assert found.visible[chosen].any(axis=0).mean() > 0.8


def test_a_slat_barely_wider_than_the_text_is_high_gets_text_as_long_as_itself() -> None:
    slats = [moved(cuboid(30, 0.9, 0.9), shift=(0, 5 * level, 0)) for level in range(-2, 3)]
    found = placed(join(*slats))
    chosen = list(found.start)
    assert found.boxes.size[chosen, 0].max() >= WIDTHS[1]


def test_text_that_slid_over_an_edge_does_not_stand_on_its_head() -> None:
    found = placed(join(*[moved(cuboid(30, 0.9, 0.9), shift=(0, 5 * level, 0)) for level in range(-2, 3)]))
    level = np.einsum("bi,bi->b", found.boxes.axes[:, 1], upright(found.boxes.axes[:, 2])[:, 1])
    assert level.min() > -1e-9


def test_a_direction_in_which_only_a_grazing_mark_is_seen_gets_one_that_faces_it() -> None:
    wedge = join(cuboid(30, 8, 30), moved(cuboid(2.8, 6, 2.8), shift=(0, 7, 0)))
    found = placed(wedge)
    chosen = list(found.start)
    served, _ = found.coverage(chosen)
    assert served[:24].min() > 0.7


def test_the_two_sides_of_a_plate_get_no_more_marks_than_show_something_new() -> None:
    found = placed(cuboid(30, 30, 1))
    chosen = list(found.start)
    front = found.boxes.axes[chosen, 2, 2] > 0.9
    assert 1 <= front.sum() <= 3


def test_where_places_were_refused_more_are_looked_for_on_the_sides_that_show_nothing_now() -> None:
    rng = np.random.default_rng(0)
    context = opened(cuboid(30, 30, 30), rng)
    found = place(context, rng)
    front = np.flatnonzero(found.boxes.axes[:, 2, 2] > 0.9)
    standing = [one for one in found.start if one not in front]
    more = search_again(context, found, standing, front.tolist(), rng)
    assert np.array_equal(more.boxes.center[: len(found.boxes)], found.boxes.center)
    new = np.arange(len(found.boxes), len(more.boxes))
    assert len(new) > 0
    assert set(standing) < set(more.start)
    assert more.visible[list(more.start)][:, 0].any()


def test_where_nothing_was_refused_no_more_is_looked_for() -> None:
    rng = np.random.default_rng(0)
    context = opened(cuboid(30, 30, 30), rng)
    found = place(context, rng)
    assert len(search_again(context, found, found.start, (), rng).boxes) == len(found.boxes)


def test_more_widths_never_make_the_choice_worse() -> None:
    found = placed(join(cuboid(30, 2, 2), moved(cuboid(3.2, 12, 3.2), shift=(0, 6, 0))))
    widths = np.unique(found.boxes.size[:, 0])[::-1]
    best = -np.inf
    start: list[int] = []
    for width in widths:
        some = np.flatnonzero(found.boxes.size[:, 0] < width)
        start = select(found, 16, rejected=some.tolist(), start=start)
        assert found.value(start) >= best
        best = found.value(start)


def test_salient_parts_are_spared_while_there_is_anything_else() -> None:
    ball = moved(sphere(3.5), shift=(0, 0, 3))
    found = placed(join(cuboid(30, 30, 1), ball))
    chosen = list(found.start)
    assert found.last_resort.any()
    assert not found.last_resort[chosen].any()


def test_faces_are_not_marked_where_there_is_room_beside_them_and_other_features_seldom() -> None:
    shape, rng = sphere(15), np.random.default_rng(0)
    salient = saliency(shape, 0)
    front, top = salient.points[:, 2] > 8, salient.points[:, 1] > 10
    regions = FeatureRegions(salient.points, salient.normals, front, top)
    parameters = Parameters.model_validate({"text": "watermark"}).resolved()
    facts = SurfaceFacts(salient, features=regions)
    found = place(build_context(carrier(shape), facts, layouts(ASPECT), parameters, rng), rng)
    chosen = found.boxes[np.array(found.start)]
    assert len(chosen)
    assert (regions.under(regions.pairs_in_boxes(chosen))[0] <= 0.05).mean() > 0.8
    assert (regions.under(regions.pairs_in_boxes(found.boxes))[0] > 0.05).mean() > 0.2
    height = found.boxes.center[:, 1]
    assert np.median(found.cost[height > 12]) > np.median(found.cost[height < -12])


def test_an_asset_with_less_surface_than_the_text_covers_is_refused_before_any_search() -> None:
    needle = surface(np.array([[0, 0, 0], [1e-9, 0, 0], [0, 30.0, 0]]), np.array([[0, 1, 2]]))
    with pytest.raises(MeshmarkError) as caught:
        placed(needle)
    assert caught.value.code is ErrorCode.NO_PLACEMENT
    assert "area" in caught.value.message
