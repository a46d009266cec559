import numpy as np
import pytest

from core.analysis.facts import SurfaceFacts
from core.analysis.saliency import saliency
from core.geometry.boxes import Boxes
from core.geometry.surface import Surface
from core.parameters import Parameters
from core.placement.context import PlacementContext, build_context
from core.placement.fit import fit, refit
from core.placement.rejection import Stage
from tests.core.placement.shapes import box, carrier, cuboid, inside_out, join, layouts, moved, sphere, text

TEXT = text(0.125)


def upwards(context: PlacementContext) -> np.ndarray:
    """(D,) the direction from above alone."""
    return np.asarray(context.targets.directions[:, 1] > 0.999)


def opened(shape: Surface) -> PlacementContext:
    parameters = Parameters(text="watermark").resolved()
    rng = np.random.default_rng(0)
    return build_context(carrier(shape), SurfaceFacts(saliency(shape, 0)), layouts(0.125), parameters, rng)


def test_each_stage_leaves_no_more_boxes_than_the_one_before() -> None:
    found, left = fit(opened(sphere(15)), TEXT, 3.0, None, np.random.default_rng(0), lambda _: None)
    assert list(left) == list(Stage)
    counts = list(left.values())
    assert counts == sorted(counts, reverse=True)
    assert len(found.boxes) == counts[-1] > 0
    assert np.all(found.boxes.size[:, 0] == 3.0)


def test_boxes_are_looked_for_only_where_they_are_wanted() -> None:
    ball = opened(sphere(15))
    found, _ = fit(ball, TEXT, 3.0, upwards(ball), np.random.default_rng(0), lambda _: None)
    assert (found.boxes.axes[:, 2, 1] > np.cos(np.radians(50))).all()


def test_no_search_is_spent_on_surface_that_nobody_sees() -> None:
    hollow = join(cuboid(30, 30, 30), *(moved(cuboid(4, 4, 4), shift=(x, 0, 0)) for x in (-8, 0, 8)))
    _, left = fit(opened(hollow), TEXT, 2.0, None, np.random.default_rng(0), lambda _: None)
    _, plain = fit(opened(cuboid(30, 30, 30)), TEXT, 2.0, None, np.random.default_rng(0), lambda _: None)
    assert left[Stage.CANDIDATES] == pytest.approx(plain[Stage.CANDIDATES], rel=0.1)
    assert left[Stage.OPEN] > 0.95 * left[Stage.SMOOTH]


def test_an_asset_that_looks_inwards_has_nothing_to_fit() -> None:
    found, left = fit(opened(inside_out(cuboid(30, 30, 30))), TEXT, 3.0, None, np.random.default_rng(0), lambda _: None)
    assert left[Stage.CANDIDATES] == 0
    assert len(found.boxes) == 0


def test_a_place_at_an_edge_costs_more_than_one_in_the_middle() -> None:
    cube = opened(cuboid(30, 30, 30))
    found, _ = fit(cube, TEXT, 5.5, upwards(cube), np.random.default_rng(0), lambda _: None)
    half = found.boxes.size[:, :2] / 2
    room = (15 - np.abs(found.boxes.center[:, [0, 2]]) - half).min(axis=1)
    upright = np.abs(found.boxes.axes[:, 0, 0]) > 0.99
    edge, middle = upright & (room < 0.3), upright & (room > 2)
    assert found.cost[edge].mean() > found.cost[middle].mean()


def test_candidates_that_stand_badly_are_not_fitted() -> None:
    blocks = [moved(cuboid(2.5, 2.5, 2.5), shift=(5 * x, 5 * y, 0)) for x in range(-2, 3) for y in range(-2, 3)]
    plate = moved(cuboid(30, 30, 1), shift=(0, 0, -4))
    _, left = fit(opened(join(plate, *blocks)), TEXT, 4.0, None, np.random.default_rng(0), lambda _: None)
    assert left[Stage.COVERED] > 0.9 * left[Stage.CANDIDATES]  # 0.63 of candidates as they are drawn


def test_a_box_that_has_no_room_where_it_is_moved_to_is_dropped() -> None:
    front = opened(cuboid(30, 30, 30))
    there = Boxes.concat(box((0, 0, 15), size=(2, 0.25, 0.3)), box((0, 0, 0), size=(2, 0.25, 0.3)))
    found = refit(front, there)
    assert found.boxes.center.round(2).tolist() == [[0, 0, 15]]
    assert len(refit(front, Boxes.empty()).boxes) == 0
