import pytest

from core.artwork.layout import set_text
from core.artwork.shaping import Glyph
from core.artwork.typeface import default_face, uploaded_face
from core.errors import ErrorCode, MeshmarkError
from tests.core.artwork.fontsmith import SQUARE, growing, make_font

FONT = default_face().font


def shape(text: str, font: bytes | None = None) -> list[Glyph]:
    """The glyphs of a text in a font of one's own; by default that is the bundled one, whatever is installed."""
    return set_text(text, own=uploaded_face(font) if font else default_face()).glyphs


def glyph_ids(text: str) -> list[int]:
    return [glyph.id for glyph in shape(text)]


def nominal(text: str) -> list[int]:
    return [FONT.get_nominal_glyph(ord(character)) for character in text]


def refusal(text: str) -> MeshmarkError:
    with pytest.raises(MeshmarkError) as caught:
        shape(text)
    return caught.value


def test_latin_text_runs_from_left_to_right() -> None:
    assert glyph_ids("water") == nominal("water")
    origins = [glyph.x for glyph in shape("water")]
    assert origins == sorted(set(origins))


def test_pairs_are_kerned() -> None:
    assert shape("AV")[1].x < FONT.get_glyph_h_advance(nominal("A")[0])


def test_ligatures_are_formed() -> None:
    assert len(glyph_ids("fi")) == 1


def test_composed_and_decomposed_letters_look_the_same() -> None:
    assert shape("e\u0301") == shape("\u00e9")


def test_a_combining_mark_stands_over_its_letter() -> None:
    letter, mark = shape("q\u0308")
    extents = FONT.get_glyph_extents(mark.id)
    middle = mark.x + extents.x_bearing + extents.width / 2
    assert letter.x < middle < letter.x + FONT.get_glyph_h_advance(letter.id)


def test_hebrew_runs_from_right_to_left_and_its_digits_do_not() -> None:
    assert glyph_ids("\u05d0\u05d1 12") == nominal("12 \u05d1\u05d0")


def test_brackets_are_mirrored_in_right_to_left_text() -> None:
    assert glyph_ids("(\u05d0)") == nominal("(\u05d0)")


def test_arabic_letters_join_and_a_non_joiner_parts_them() -> None:
    joined, parted = glyph_ids("\u0628\u0628"), glyph_ids("\u0628\u200c\u0628")
    isolated = nominal("\u0628")[0]
    assert isolated not in joined
    assert isolated in parted


def test_mixed_directions_follow_the_first_strong_character() -> None:
    assert glyph_ids("a \u05d0\u05d1 b") == nominal("a \u05d1\u05d0 b")
    assert glyph_ids("\u05d0 a b") == nominal("a b \u05d0")


def test_the_machine_locale_does_not_change_the_letters(monkeypatch: pytest.MonkeyPatch) -> None:
    before = shape("\u0431\u0433\u0434")  # Serbian and Russian draw these differently where the font can
    monkeypatch.setenv("LANG", "sr_RS.UTF-8")
    assert shape("\u0431\u0433\u0434") == before


def test_every_missing_character_is_listed_once_with_its_code() -> None:
    error = refusal("\ue000a\ue001\ue000\U0001f98a")
    assert error.code == ErrorCode.MISSING_GLYPHS
    assert error.message.count("U+E000") == 1
    assert "U+E001" in error.message
    assert "\U0001f98a (U+1F98A)" in error.message


def test_a_character_with_a_blank_picture_is_missing() -> None:
    font = make_font({"a": [SQUARE], "\ue000": []})
    with pytest.raises(MeshmarkError, match=r"\(U\+E000\)") as caught:
        shape("a\ue000", font)
    assert caught.value.code == ErrorCode.MISSING_GLYPHS


@pytest.mark.parametrize("text", ["", " ", "\t\n ", "\u3000\u00a0"])
def test_text_of_only_spaces_is_empty(text: str) -> None:
    assert refusal(text).code == ErrorCode.EMPTY_TEXT


@pytest.mark.parametrize(
    "character", ["\t", "\r", "\0", "\x7f", "\u2028", "\u2029", "\u202e", "\u2067", "\ufeff", "\ud800"]
)
def test_control_characters_are_refused_by_their_code_and_place(character: str) -> None:
    error = refusal(f"ab{character}c")
    assert error.code == ErrorCode.INVALID_PARAMETERS
    assert f"U+{ord(character):04X} at position 3" in error.message


@pytest.mark.parametrize("text", ["a", "a" * 60])
def test_a_font_whose_rules_multiply_letters_is_refused_for_it(text: str) -> None:
    with pytest.raises(MeshmarkError, match="glyphs of a letter") as caught:
        shape(text, growing(levels=3))
    assert caught.value.code is ErrorCode.INVALID_FONT


def test_a_font_may_write_a_letter_as_several_glyphs() -> None:
    assert len(shape("aa", growing(levels=1))) == 40
