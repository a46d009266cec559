"""The manual's pictures: those that `make pictures` draws, small, and all shown."""

import re
from io import BytesIO

import numpy as np
import pytest
from PIL import Image

from tests.figures import FIGURES, HEAT, PAPER, heat, sphere
from tests.manual import MANUAL
from tests.pictures import FOLDER, NAMES, PICTURES, Picture, draw
from tests.tiles import CAPTION, TILE

SHOWN = re.findall(
    r"!\[([^\]]*)\]\(pictures/([\w-]+)\.webp\)", "".join(page.read_text() for page in MANUAL.glob("*.md"))
)


def test_every_picture_there_is_is_shown_with_words_and_those_that_are_drawn_are_there() -> None:
    there = {path.stem for path in FOLDER.iterdir()}
    assert {*NAMES} <= there
    assert there == {name for _, name in SHOWN}
    assert all(len(words) > 15 for words, _ in SHOWN)


def test_the_pictures_are_small() -> None:
    sizes = [path.stat().st_size for path in FOLDER.iterdir()]
    assert max(sizes) <= 60 * 1024
    assert sum(sizes) <= 1024 * 1024


def test_a_picture_has_a_tile_for_each_case() -> None:
    for name, picture in PICTURES.items():
        with Image.open(FOLDER / f"{name}.webp") as shown:
            assert shown.width // TILE == len(picture.cases), name


def test_there_is_a_figure_for_each_kind_of_metric() -> None:
    assert len(FIGURES) == 7
    for name in FIGURES:
        with Image.open(FOLDER / f"{name}.webp") as shown:
            assert shown.width // TILE in (2, 3), name


def test_on_the_map_of_the_sphere_the_front_is_in_the_middle_and_what_sees_nothing_is_grey() -> None:
    directions = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    shown = np.asarray(sphere(directions, np.array([4, 0])), dtype=int)
    red, _, blue = shown[TILE // 2, TILE // 2]
    assert red - blue > 80
    assert np.ptp(shown[TILE // 2, TILE // 2 + round(0.44 * TILE / 2**0.5)]) < 10
    assert tuple(shown[0, 0]) == PAPER


def test_the_colours_of_values_go_from_the_first_to_the_last() -> None:
    np.testing.assert_array_equal(heat(np.array([0.0, 1.0, 7.0])), HEAT[[0, -1, -1]])


@pytest.mark.parametrize("near", [0, 1.2])
def test_a_picture_is_drawn(near: float) -> None:
    content = draw(Picture((("one", {"text": "HI", "count": 1, "color": "#d02020"}),), near))
    with Image.open(BytesIO(content)) as drawn:
        assert drawn.size == (TILE, TILE + CAPTION)
        red, green, blue = np.asarray(drawn.convert("RGB"), dtype=int).transpose(2, 0, 1)
    assert ((red > 120) & (green < 80) & (blue < 80)).any() or not near, "the letters are in a picture from near by"
