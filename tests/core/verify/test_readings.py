"""Lines of writing are read where they are long enough to be what is looked for."""

from functools import cache

import cv2
import numpy as np
import pytest

from core.metrics.recognition import Reader
from core.verify.look import Look
from core.verify.readings import readings

SIZE = 512


@cache
def reader() -> Reader:
    return Reader(threads=1)


def wall_that_says(text: str, scale: float) -> Look:
    """A look at a wall across the view, with a text in its middle."""
    picture = np.full((SIZE, SIZE, 3), 230, dtype=np.uint8)
    (width, height), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_DUPLEX, scale, 2)
    corner = (SIZE - width) // 2, (SIZE + height) // 2
    cv2.putText(picture, text, corner, cv2.FONT_HERSHEY_DUPLEX, scale, (20, 20, 20), 2, cv2.LINE_AA)
    depth = np.full((SIZE, SIZE), 75, dtype=np.float32)
    return Look(picture, depth, center=np.zeros(3), axes=np.eye(3), slope=0.25, radius=18.0, grain=1.0)


def read(look: Look, letters: int) -> list[str]:
    return [one.text for one in readings([look], ["ordinary"], reader(), letters)]


@pytest.mark.parametrize(("text", "scale"), [("AI", 4.0), ("ORDER 4711", 1.5), ("watermark", 0.8)])
def test_a_text_is_read_by_who_looks_for_one_of_its_length(text: str, scale: float) -> None:
    assert text in read(wall_that_says(text, scale), len(text.replace(" ", "")))


def test_what_is_much_shorter_than_the_text_that_is_looked_for_is_not_read() -> None:
    assert read(wall_that_says("AI", 4.0), letters=12) == []
