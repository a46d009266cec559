"""Letters of a label as high in pictures as its rule asks for."""

import numpy as np
import pytest

from core.geometry.boxes import Boxes
from core.geometry.directions import EYE_DISTANCE, view_directions
from core.notices import NoticeCode
from core.parameters import Parameters
from core.placement.context import build_context
from core.placement.label_height import label_heights, picture_side, too_small
from core.placement.options import PAPER, PLACEMENT, STRONG, labelling
from tests.core.placement.shapes import box, boxes, carrier, cuboid, layouts, rotation
from tests.core.placement.test_options import FACTS

RADIUS = 18.0
FRONT = np.array([0, 12])
ALL = np.ones((1, 24), dtype=bool)


def test_letters_are_measured_against_the_picture_as_the_camera_shows_them() -> None:
    side = picture_side(RADIUS)
    assert side == pytest.approx(2 * 1.03 * RADIUS, rel=0.04)  # the whole asset and a margin
    middle = label_heights(box((0, 0, 0)), np.array([2.0]), ALL, RADIUS)
    np.testing.assert_allclose(middle[FRONT], 2 / side, rtol=1e-9)
    near = label_heights(box((0, 0, 15)), np.array([2.0]), ALL, RADIUS)
    np.testing.assert_allclose(near[FRONT], 2 / side * EYE_DISTANCE / (EYE_DISTANCE - 15), rtol=1e-9)


def test_letters_that_are_turned_about_in_the_picture_are_as_high() -> None:
    plain = box((0, 0, 0))
    rolled = Boxes(plain.center, plain.axes @ rotation((0, 0, 1), 70.0).T, plain.size)
    for which in FRONT:
        heights = [label_heights(one, np.array([2.0]), ALL, RADIUS)[which] for one in (plain, rolled)]
        assert heights[0] == pytest.approx(heights[1])


def test_letters_seen_from_above_are_lower_and_the_highest_ones_count() -> None:
    directions, _ = view_directions()
    tilted = np.flatnonzero(np.isclose(directions[:, 1], np.sin(np.radians(30))) & (directions[:, 2] > 0))
    heights = label_heights(box((0, 0, 0)), np.array([2.0]), ALL, RADIUS)
    np.testing.assert_allclose(heights[tilted] / heights[0], np.cos(np.radians(30)), rtol=0.01)
    both = boxes(box((0, 0, 0)), box((0, 0, 0)))
    assert label_heights(both, np.array([2.0, 1.0]), np.ones((2, 24), dtype=bool), RADIUS)[0] == heights[0]


def test_letters_that_are_not_seen_do_not_count() -> None:
    assert not label_heights(box((0, 0, 0)), np.array([2.0]), ~ALL, RADIUS).any()
    assert not label_heights(Boxes.empty(), np.empty(0), np.empty((0, 24), dtype=bool), RADIUS).any()


def test_a_label_that_is_too_small_somewhere_is_told_of() -> None:
    assert too_small(np.full(24, 0.05), 0.05) == []
    [notice] = too_small(np.array([0.049, *np.full(23, 0.06)]), 0.05)
    assert notice.code == NoticeCode.LABEL_TOO_SMALL
    assert "23 of 24" in notice.message
    assert "6.0%" in notice.message


@pytest.mark.parametrize("colored", [False, True])
def test_a_label_with_a_rule_is_looked_for_that_large(colored: bool) -> None:
    options = labelling(4.0, colored)
    assert options.search.heights[0] > STRONG.search.heights[0]
    assert options.objective.large > labelling(2.0, colored).objective.large


def test_only_a_label_whose_rule_has_a_height_is() -> None:
    def options(**asked: str) -> object:
        parameters = Parameters.model_validate(asked).resolved()
        rng = np.random.default_rng(0)
        return build_context(carrier(cuboid(30, 30, 30)), FACTS, layouts(0.3), parameters, rng).options

    assert options(text="a") == options(label="eu") == PLACEMENT
    assert options(label="cn", preset="paper") == PAPER
    assert options(label="cn") == labelling(0.05 * picture_side(cuboid(30, 30, 30).radius), colored=True)
