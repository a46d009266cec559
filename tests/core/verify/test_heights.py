"""Heights over the original tell what stands out of it from what does not."""

import numpy as np
import pytest

from core.geometry.boxes import Boxes
from core.geometry.spatial import SpatialIndex
from core.verify.heights import ABOVE, BELOW, LEVEL, NOTHING, height_field, height_picture, standing_out, tallest
from tests.core.placement.shapes import cuboid

BOX = Boxes(np.array([[0.0, 0, 2]]), np.eye(3)[None], np.array([[8.0, 4, 2]]))


def index(*boxes: tuple[float, float, float, float]) -> SpatialIndex:
    """Blocks of a width, a depth and a height, each moved along x."""
    parts = [cuboid(*size) for *size, _ in boxes]
    positions = [part.positions + np.array([shift, 0, 0]) for part, (*_, shift) in zip(parts, boxes, strict=True)]
    first = np.cumsum([0, *(len(part.positions) for part in parts)])
    return SpatialIndex(
        np.concatenate(positions), np.concatenate([part.faces + row for part, row in zip(parts, first, strict=False)])
    )


PLATE = (20.0, 20.0, 4.0, 0.0)


@pytest.mark.parametrize("sign", [1, -1])
def test_a_step_has_its_height(sign: int) -> None:
    plate, stepped = index(PLATE), index(PLATE, (4.0, 20.0, 5.0, -3.0))
    height, met = height_field(BOX, *((stepped, plate) if sign > 0 else (plate, stepped)))
    assert met.all()
    assert tallest(height, met) == pytest.approx(sign * 0.5, abs=1e-5)
    assert standing_out(height, met, 0.5) == pytest.approx(0.375, abs=0.01)
    picture = height_picture(height, met)
    assert tuple(picture[0, 0]) == (ABOVE if sign > 0 else BELOW)
    assert tuple(picture[0, -1]) == LEVEL


def test_what_is_the_same_stands_out_nowhere_and_what_was_moved_a_little_neither() -> None:
    plate = index(PLATE)
    for suspect in (plate, index((20.0, 20.0, 4.1, 0.0))):
        height, met = height_field(BOX, suspect, plate)
        assert standing_out(height, met, 0.05) == 0
        assert tallest(height, met) == 0


def test_where_nothing_is_left_nothing_is_said() -> None:
    height, met = height_field(BOX, index((1.0, 1.0, 4.0, 30.0)), index(PLATE))
    assert not met.any()
    assert (tallest(height, met), standing_out(height, met, 0.5)) == (0, 0)
    assert (height_picture(height, met) == NOTHING).all()
