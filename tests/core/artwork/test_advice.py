"""What helps where there is no room depends on what was to be embossed."""

from typing import Any

import pytest

from core.artwork.advice import plainer, smaller, subject
from core.artwork.layouts import Layouts
from core.artwork.lettering import layouts_of
from core.parameters import Parameters

SVG = b"<svg xmlns='http://www.w3.org/2000/svg' viewBox='0 0 9 9'><path d='M0 0h9v9z'/></svg>"
ADDRESS = "https://a.example"


def mark(svg: bytes | None = None, **asked: Any) -> Layouts:
    return layouts_of(Parameters(**asked), logo=svg)


@pytest.mark.parametrize(
    ("layouts", "name", "instead"),
    [
        (mark(text="HI"), "text", "a shorter text"),
        (mark(SVG), "logo", "a simpler logo"),
        (mark(SVG, text="HI"), "logo with the text", "a shorter text or a simpler logo"),
        (mark(qr=ADDRESS), "QR code", "a shorter address"),
        (mark(qr=ADDRESS, text="HI"), "QR code with the text", "a shorter text or address"),
    ],
    ids=["text", "logo", "logo and text", "code", "code and text"],
)
def test_each_kind_of_mark_has_its_own_name_and_its_own_way_to_need_less_room(
    layouts: Layouts, name: str, instead: str
) -> None:
    assert (subject(layouts), plainer(layouts)) == (name, instead)
    assert smaller(layouts).endswith(f"or use {instead}.")


def test_no_size_is_advised_that_would_be_refused() -> None:
    code = mark(qr=ADDRESS)
    assert smaller(code, 4.9) == "Ask for a `size` below 4.9, of 2.1 or more, or use a shorter address."
    assert smaller(code, 2.1) == "Use a shorter address."
    text = mark(text="HI")
    assert smaller(text, 4.9) == "Ask for a `size` below 4.9, or use a shorter text."
    assert smaller(text, 0.4) == "Use a shorter text."
