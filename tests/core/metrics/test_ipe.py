from core.metrics.ipe import ipe
from tests.core.placement.shapes import cuboid, join, moved


def test_an_unchanged_number_of_parts_is_no_error() -> None:
    assert ipe(cuboid(1, 1, 1), cuboid(2, 2, 2)) == 0


def test_letters_that_float_beside_the_asset_count_one_each() -> None:
    block, letter = cuboid(10, 10, 10), cuboid(1, 1, 1)
    marked = join(block, moved(letter, shift=(0, 0, 7)), moved(letter, shift=(2, 0, 7)))
    assert ipe(block, marked) == 2


def test_lost_parts_count_as_added_ones_do() -> None:
    assert ipe(join(cuboid(1, 1, 1), moved(cuboid(1, 1, 1), shift=(5, 0, 0))), cuboid(1, 1, 1)) == 1
