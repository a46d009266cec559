from io import BytesIO

import pytest
from fontTools.ttLib import TTFont

from core.artwork.outline import text_artwork
from core.artwork.typeface import default_face, uploaded_face
from tests.core.artwork.fontsmith import SQUARE, make_font


def renamed(name: str) -> bytes:
    font = TTFont(BytesIO(make_font({"a": [SQUARE]})))
    font["name"].setName(name, 4, 3, 1, 0x409)
    stream = BytesIO()
    font.save(stream)
    return stream.getvalue()


def test_a_typeface_is_named_as_it_says_itself() -> None:
    face = default_face()
    assert (face.name, face.version, face.offset) == ("DejaVu Sans Bold", "2.37", 0.0)


@pytest.mark.parametrize(("name", "kept"), [("My\u202eFont\n", "MyFont"), ("x" * 5000, "x" * 100), ("\0", "unnamed")])
def test_a_name_that_could_do_harm_in_a_report_is_cut(name: str, kept: str) -> None:
    assert uploaded_face(renamed(name)).name == kept


def test_composed_and_decomposed_letters_are_both_had() -> None:
    face = uploaded_face(make_font({"e": [SQUARE], "\u0301": [SQUARE], "\u00fc": [SQUARE]}))
    assert face.lacks("\u00e9") == []  # of its parts
    assert face.lacks("\u00fc") == []
    assert face.lacks("\u00e8") == ["\u00e8"]
    assert face.lacks("e\ufe0f\u200d") == []  # variation selectors and joiners need no glyph


def test_a_variable_font_is_set_in_bold() -> None:
    variable = make_font({"a": [SQUARE]}, widened="wght")
    assert text_artwork("a", make_font({"a": [SQUARE]})).aspect == pytest.approx(1)
    assert text_artwork("a", variable).aspect == pytest.approx(0.5)
