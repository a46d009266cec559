"""The manual's pictures: those that `make pictures` draws, small, and all shown."""

import re
from io import BytesIO

import numpy as np
import pytest
from PIL import Image

from tests.manual import MANUAL
from tests.pictures import CAPTION, FOLDER, NAMES, PICTURES, TILE, Picture, draw

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


@pytest.mark.parametrize("near", [0, 1.2])
def test_a_picture_is_drawn(near: float) -> None:
    content = draw(Picture((("one", {"text": "HI", "count": 1, "color": "#d02020"}),), near))
    with Image.open(BytesIO(content)) as drawn:
        assert drawn.size == (TILE, TILE + CAPTION)
        red, green, blue = np.asarray(drawn.convert("RGB"), dtype=int).transpose(2, 0, 1)
    assert ((red > 120) & (green < 80) & (blue < 80)).any() or not near, "the letters are in a picture from near by"
