import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from core.geometry.boxes import Boxes
from core.geometry.sampling import sample
from core.geometry.surface import Surface
from core.placement.filters import (
    FilterOptions,
    above,
    edge_proximity,
    folded,
    footprint,
    fully_supported,
    occluded,
    overlapping,
    recentre,
    roughness,
    roughness_met,
    smooth,
    support,
    thin_walled,
    tilted,
    well_aligned,
)
from core.placement.finetune import distinct
from tests.core.placement.shapes import (
    box,
    boxes,
    cuboid,
    index_of,
    inside_out,
    join,
    moved,
    plane,
    rotation,
    sphere,
    surface,
)

CLEARANCE = 0.2


def one_part(shape: Surface) -> NDArray[np.int64]:
    return np.zeros(len(shape.faces), dtype=np.int64)


def is_covered(shape: Surface, where: Boxes, part: NDArray[np.int64] | None = None) -> bool:
    met = footprint(where, index_of(shape), shape.normals, CLEARANCE)
    return bool(fully_supported(met, where, one_part(shape) if part is None else part)[0])


def slid_twice(shape: Surface, where: Boxes, part: NDArray[np.int64] | None = None) -> Boxes:
    for ahead in (2.0, 1.0):
        met = footprint(where, index_of(shape), shape.normals, CLEARANCE, (12, 16), 0.16)
        where = recentre(where, met, one_part(shape) if part is None else part, ahead)
    return where


def surface_points(shape: Surface, where: Boxes, lift: float) -> NDArray[np.float64]:
    return above(where, footprint(where, index_of(shape), shape.normals, CLEARANCE), lift)


def rough(shape: Surface, where: Boxes) -> float:
    points, face = sample(shape, 4000, np.random.default_rng(0))
    return float(roughness(where, points, shape.normals[face])[0])


def rough_by_rays(shape: Surface, where: Boxes) -> float:
    return float(roughness_met(footprint(where, index_of(shape), shape.normals, CLEARANCE), shape.normals)[0])


def test_rays_find_about_the_same_roughness_as_area_samples() -> None:
    for shape, where in ((plane(10, 10), box()), (sphere(10), box((0, 0, 10), size=(6, 2, 1.5)))):
        assert rough_by_rays(shape, where) == pytest.approx(rough(shape, where), abs=0.02)


def test_a_box_over_nothing_is_infinitely_rough() -> None:
    assert rough_by_rays(plane(1, 1), box((20, 0, 0))) == np.inf


def test_only_boxes_below_the_papers_loss_are_well_aligned() -> None:
    assert well_aligned(np.array([0.0, 0.0049, 0.005, np.inf])).tolist() == [True, True, False, False]


def test_a_box_in_the_middle_of_a_plane_is_covered() -> None:
    assert is_covered(plane(10, 10), box())


def test_a_box_that_hangs_over_an_edge_is_not_covered() -> None:
    assert not is_covered(plane(10, 10), box((3.5, 0, 0)))
    assert not is_covered(cuboid(10, 10, 10), box((3.5, 0, 5)))


def test_letters_keep_clear_of_a_border_that_the_box_just_touches() -> None:
    assert not is_covered(plane(10, 10), box((3, 0, 0)))
    assert is_covered(plane(10, 10), box((2.9, 0, 0)))


@pytest.mark.parametrize("start", [(4, 0, 0), (0, -4.9, 0), (-3.5, 4.8, 0)], ids=["right", "bottom", "corner"])
def test_a_box_that_hangs_over_an_edge_is_slid_back_onto_the_surface(start: tuple[float, float, float]) -> None:
    shape, where = plane(10, 10), box(start)
    where = slid_twice(shape, where)
    assert is_covered(shape, where)
    assert np.linalg.norm(where.center - start) < 2.1


def test_a_box_on_a_strip_as_wide_as_itself_is_slid_to_its_middle() -> None:
    strip = plane(10, 1.3)
    where = slid_twice(strip, box((0, 0.4, 0)))
    assert where.center[0] == pytest.approx([0, 0, 0], abs=0.06)
    assert is_covered(strip, where)


def test_boxes_with_nothing_or_everything_under_them_stay() -> None:
    for shape, where in ((plane(10, 10), box((20, 0, 0))), (plane(10, 10), box())):
        met = footprint(where, index_of(shape), shape.normals, CLEARANCE)
        assert recentre(where, met, one_part(shape), 2.0).center == pytest.approx(where.center)


def test_a_box_across_two_parts_is_slid_onto_one_of_them() -> None:
    half = plane(10, 10)
    flush = join(moved(half, shift=(-5, 0, 0)), moved(half, shift=(5, 0, 0)))
    part, across = np.repeat([0, 1], len(half.faces)), box((1, 0, 0))
    assert is_covered(flush, across)
    assert not is_covered(flush, across, part)
    where = slid_twice(flush, across, part)
    assert is_covered(flush, where, part)
    assert where.center[0] == pytest.approx([2.1, 0, 0], abs=0.2)


def test_half_of_a_box_stands_where_half_of_it_hangs_over_an_edge_or_another_part() -> None:
    half = plane(10, 10)
    flush = join(moved(half, shift=(-5, 0, 0)), moved(half, shift=(5, 0, 0)))
    for shape, where, part in ((half, box((5, 0, 0)), one_part(half)), (flush, box((0.1, 0, 0)), np.repeat([0, 1], 2))):
        met = footprint(where, index_of(shape), shape.normals, CLEARANCE)
        assert support(met, where, part)[0] == pytest.approx(0.5, abs=0.05)


def test_a_box_over_a_hole_is_not_covered() -> None:
    shape = plane(10, 10, cells=20)
    middle = np.linalg.norm(shape.positions[shape.faces].mean(axis=1), axis=1)
    assert not is_covered(surface(shape.positions, shape.faces[middle > 0.7]), box())


def test_a_box_on_a_step_higher_than_itself_is_not_covered() -> None:
    step = join(moved(plane(10, 10), shift=(-5, 0, 0)), moved(plane(10, 10), shift=(5, 0, -0.6)))
    assert not is_covered(step, box())


def test_another_layer_within_the_letters_reach_uncovers_a_box() -> None:
    def over(height: float) -> Surface:
        return join(plane(10, 10), moved(inside_out(plane(10, 10)), shift=(0, 0, height)))

    assert not is_covered(over(0.4), box())
    assert is_covered(over(0.5), box())


def test_a_surface_that_looks_away_from_the_box_does_not_cover_it() -> None:
    assert not is_covered(inside_out(plane(10, 10)), box())


def test_the_footprint_reports_the_height_of_the_surface_over_the_middle_plane() -> None:
    met = footprint(
        box((0, 0, 1.5)), index_of(moved(plane(10, 10), shift=(0, 0, 1.6))), np.array([[0, 0, 1.0]] * 2), 0.3
    )
    assert met.height == pytest.approx(0.1, abs=1e-5)
    assert met.cosine == pytest.approx(1)
    missed = footprint(box((50, 0, 0)), index_of(plane(10, 10)), np.array([[0, 0, 1.0]] * 2), 0.3)
    assert np.all(missed.height == -np.inf)
    assert np.all(missed.cosine == -1)


def test_flat_ground_has_roughness_one_however_coarse() -> None:
    assert rough(plane(10, 10), box()) == pytest.approx(1)
    assert rough(plane(10, 10, cells=40), box()) == pytest.approx(1)


def test_a_roof_is_as_rough_as_the_angle_between_its_sides() -> None:
    # Two halves, their normals 60 degrees apart: 1/cos is 1 within a side and 2 between the sides.
    left = moved(plane(20, 20), rotation((0, 1, 0), -30), (-10 * np.cos(np.pi / 6), 0, -5))
    right = moved(plane(20, 20), rotation((0, 1, 0), 30), (10 * np.cos(np.pi / 6), 0, -5))
    found = rough(join(left, right), box(size=(4, 4, 4)))
    assert found == pytest.approx(1.5, abs=0.1)
    assert not smooth(np.array([found]))[0]


def test_a_coarse_step_without_a_vertex_inside_is_still_rough() -> None:
    assert rough(cuboid(20, 20, 20), box((10, 0, 10), (4, 4, 4), rotation((0, 1, 0), -45))) > 1.25


def test_the_far_side_of_a_thin_wall_is_not_roughness() -> None:
    assert rough(cuboid(20, 20, 0.1), box((0, 0, 0.05), (6, 3, 0.5))) == pytest.approx(1)


def test_a_box_away_from_the_surface_is_infinitely_rough() -> None:
    assert rough(plane(10, 10), box((0, 0, 9))) == np.inf


def fold(shape: Surface, where: Boxes) -> list[float]:
    met = footprint(where, index_of(shape), shape.normals, CLEARANCE)
    return [float(share) for share in folded(met, shape.normals)]


def test_text_over_an_edge_is_folded_by_what_lies_beyond_it() -> None:
    left = moved(plane(20, 20), rotation((0, 1, 0), -30), (-10 * np.cos(np.pi / 6), 0, -5))
    right = moved(plane(20, 20), rotation((0, 1, 0), 30), (10 * np.cos(np.pi / 6), 0, -5))
    where = boxes(*(box((x, 0, 0), size=(4, 0.5, 4)) for x in (0.0, 1.0, 3.0)))
    assert fold(join(left, right), where) == pytest.approx([0.5, 0.25, 0], abs=0.05)


def test_text_round_a_bend_or_on_shallow_facets_is_not_folded() -> None:
    where = box((0, 0, 10), size=(8, 1, 3))
    assert fold(sphere(10), where) == fold(plane(10, 10), box(size=(8, 1, 1))) == [0]
    across, down = 10 * np.cos(np.radians(8)), 10 * np.sin(np.radians(8))
    left = moved(plane(20, 20), rotation((0, 1, 0), -8), (-across, 0, -down))
    right = moved(plane(20, 20), rotation((0, 1, 0), 8), (across, 0, -down))
    assert fold(join(left, right), box(size=(4, 0.5, 4))) == [0]
    assert fold(plane(10, 10), Boxes.empty()) == []


@pytest.mark.parametrize(("degrees", "refused"), [(0, False), (8, False), (20, True)])
def test_a_box_turned_against_the_flat_ground_under_it_is_refused(degrees: float, refused: bool) -> None:
    where = Boxes(np.zeros((1, 3)), rotation((0, 1, 0), degrees)[None].transpose(0, 2, 1), np.array([[4.0, 1.0, 4.0]]))
    shape = plane(20, 20)
    assert tilted(where, footprint(where, index_of(shape), shape.normals, CLEARANCE), shape.normals)[0] == refused


def test_a_box_over_a_bend_lies_on_its_ground() -> None:
    shape, where = sphere(10), box((0, 0, 10), size=(8, 1, 3))
    assert not tilted(where, footprint(where, index_of(shape), shape.normals, CLEARANCE), shape.normals)[0]


def test_roughness_of_no_boxes_is_empty() -> None:
    assert len(roughness(box()[np.array([], dtype=np.int64)], np.zeros((1, 3)), np.ones((1, 3)))) == 0


def test_a_box_that_looks_at_a_near_wall_is_occluded() -> None:
    shape = join(plane(20, 20), moved(inside_out(plane(20, 20)), shift=(0, 0, 3)))
    points = surface_points(shape, box(), 0.3)
    assert occluded(box(), points, index_of(shape), reach=4)[0]
    assert not occluded(box(), points, index_of(shape), reach=2)[0]


def test_the_curvature_under_a_box_does_not_occlude_it() -> None:
    shape = sphere(6)
    where = box((0, 0, 5.9), (2.4, 0.6, 0.5))
    assert not occluded(where, surface_points(shape, where, 0.1), index_of(shape), reach=30)[0]


@pytest.mark.parametrize("thickness", [0.4, 0.05, 0.01, 0.001])
def test_sunken_letters_need_a_wall_thicker_than_they_are_deep(thickness: float) -> None:
    shape = cuboid(20, 20, thickness)
    where = box((0, 0, thickness / 2))
    met = footprint(where, index_of(shape), shape.normals, CLEARANCE)
    for depth in (thickness * 1.02, 0.5):
        assert thin_walled(where, met, index_of(shape), np.array([depth]))[0]
    assert not thin_walled(where, met, index_of(shape), np.array([thickness * 0.75]))[0]


def test_an_open_sheet_has_no_other_side_to_break_through() -> None:
    shape = plane(20, 20)
    met = footprint(box(), index_of(shape), shape.normals, CLEARANCE)
    assert not thin_walled(box(), met, index_of(shape), np.array([0.5]))[0]


coordinate = st.floats(-4, 4)
side = st.floats(0.2, 3)
sides = st.tuples(side, side, side)
axis = st.tuples(coordinate, coordinate, coordinate).filter(lambda v: np.linalg.norm(v) > 0.1)
angle = st.floats(-180, 180)


@given(offset=st.tuples(coordinate, coordinate, coordinate), one=sides, two=sides)
def test_aligned_boxes_overlap_exactly_where_all_their_intervals_do(
    offset: tuple[float, float, float], one: tuple[float, float, float], two: tuple[float, float, float]
) -> None:
    gaps = np.abs(offset) - (np.array(one) + two) / 2
    if np.abs(gaps.max()) > 1e-6:
        assert overlapping(boxes(box((0, 0, 0), one), box(offset, two)), 0)[1] == (gaps.max() < 0)


@settings(max_examples=60)
@given(offset=st.tuples(coordinate, coordinate, coordinate), one=sides, two=sides, axis=axis, angle=angle, other=angle)
def test_turned_boxes_overlap_where_a_point_is_in_both(
    offset: tuple[float, float, float],
    one: tuple[float, float, float],
    two: tuple[float, float, float],
    axis: tuple[float, float, float],
    angle: float,
    other: float,
) -> None:
    pair = boxes(box((0, 0, 0), one, rotation(axis, angle)), box(offset, two, rotation((1, 2, 3), other)))
    grid = np.stack(np.meshgrid(*[np.linspace(-0.5, 0.5, 9)] * 3), axis=-1).reshape(-1, 3)
    points = (grid * two) @ pair.axes[1] + pair.center[1]
    shared = (np.abs(pair.to_local(0, points)) <= pair.size[0] / 2 - 1e-9).all(axis=1).any()
    meet = overlapping(pair, 0)
    assert meet[0]
    assert meet[1] == overlapping(pair, 1)[0]
    if shared:
        assert meet[1]
    turn = rotation(axis, 77)
    elsewhere = Boxes(pair.center @ turn.T + 3, pair.axes @ turn.T, pair.size)
    near_miss = overlapping(pair, 0, 1e-6)[1] != overlapping(pair, 0, -1e-6)[1]
    assert near_miss or overlapping(elsewhere, 0)[1] == meet[1]


def test_crossed_bars_that_only_an_edge_axis_separates_do_not_overlap() -> None:
    one = box((0, 0, 0), (10, 0.2, 0.2), rotation((1, 0, 0), 45))
    two = box((0, 0, 0.3), (10, 0.2, 0.2), rotation((0, 0, 1), 90) @ np.eye(3))
    turned = Boxes(two.center, two.axes @ rotation((0, 1, 0), 45).T, two.size)
    assert not overlapping(boxes(one, turned), 0)[1]
    assert overlapping(boxes(one, Boxes(turned.center - [0, 0, 0.05], turned.axes, turned.size)), 0)[1]


def test_spacing_keeps_boxes_apart() -> None:
    pair = boxes(box((0, 0, 0)), box((4.2, 0, 0)))
    assert not overlapping(pair, 0)[1]
    assert overlapping(pair, 0, spacing=0.3)[1]


def test_of_near_copies_the_best_aligned_one_stays() -> None:
    several = boxes(box((0, 0, 0)), box((0.2, 0, 0)), box((9, 0, 0)), box((0, 0.1, 0), axes=rotation((0, 0, 1), 60)))
    assert distinct(several, np.array([0.004, 0.001, 0.004, 0.004]), copy=0.05).tolist() == [1, 2, 3]


def test_a_box_close_to_an_edge_is_exposed_on_that_side_only() -> None:
    shape = plane(20, 20)
    places = boxes(box((0, 0, 0), (4, 1, 0.5)), box((7.9, 0, 0), (4, 1, 0.5)), box((7.9, 9.4, 0), (4, 1, 0.5)))
    middle, edge, corner = edge_proximity(places, places.size[:, 1], index_of(shape), shape.normals, 0.2)
    assert middle == 0
    assert 0 < edge < corner < 1


def test_edges_are_looked_for_as_far_around_a_box_as_the_options_say() -> None:
    shape = plane(30, 30)
    near = box((11.5, 0, 0), (5.5, 1, 0.5))  # ends 0.75 from the border

    def share(line: float, margin: float) -> float:
        options = FilterOptions(edge_margin=margin)
        return float(edge_proximity(near, np.array([line]), index_of(shape), shape.normals, 0.05, options)[0])

    assert share(1.0, 0.5) == 0 < share(1.0, 0.8)
    assert share(0.5, 0.8) == 0, "by the height of a line, of which two stand in the box"
