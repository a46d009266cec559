import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from core.arrays import Float
from core.artwork.artwork import Artwork
from core.artwork.layout import serving_fonts, set_text
from core.artwork.outline import text_artwork
from core.artwork.style import PLAIN, TextStyle
from core.choices import Align, Direction
from core.errors import ErrorCode, MeshmarkError
from tests.core.artwork.fontsmith import SQUARE, make_font

VERTICAL = TextStyle(direction=Direction.VERTICAL)
BOXES = make_font({character: [SQUARE] for character in "abcdef"})  # half an em wide and high, advance 0.6 em


def bands(letters: Artwork, axis: int) -> list[tuple[float, float]]:
    """The ranges of an axis, in order, that letters cover."""
    spans = sorted((float(ring[:, axis].min()), float(ring[:, axis].max())) for ring in letters.rings)
    joined = [spans[0]]
    for low, high in spans[1:]:
        if low <= joined[-1][1]:
            joined[-1] = joined[-1][0], max(high, joined[-1][1])
        else:
            joined.append((low, high))
    return joined


def lefts(letters: Artwork) -> list[float]:
    """Where each line begins, from the top one down."""
    rows = bands(letters, 1)[::-1]
    middles: list[tuple[float, Float]] = [(float(ring[:, 1].mean()), ring) for ring in letters.rings]
    return [min(float(ring[:, 0].min()) for at, ring in middles if low <= at <= high) for low, high in rows]


@pytest.mark.parametrize("text", ["one\ntwo\nthree", "one\r\ntwo\r\nthree", "\none \n two\nthree\n"])
def test_a_line_feed_begins_a_line(text: str) -> None:
    letters = text_artwork(text)
    assert letters.label == text
    assert letters.lines == ("one", "two", "three")
    assert len(bands(letters, 1)) == 3


def test_a_line_is_as_high_as_its_letters() -> None:
    block, alone = text_artwork("Hog\nHog\nHog"), text_artwork("Hog")
    assert block.line_height == pytest.approx(alone.aspect, rel=0.01)
    assert alone.line_height == alone.aspect
    assert block.aspect > 3 * block.line_height


@pytest.mark.parametrize(("align", "share"), [(Align.LEFT, 0.0), (Align.CENTER, 0.5), (Align.RIGHT, 1.0)])
def test_shorter_lines_stand_left_in_the_middle_or_right(align: Align, share: float) -> None:
    letters = text_artwork("abcd\nab", BOXES, TextStyle(align))
    width = 2.3  # ems: the last letter's own width, not its advance
    assert lefts(letters) == pytest.approx([-0.5, -0.5 + share * 1.2 / width])


@pytest.mark.parametrize("spacing", [0.8, 1.2, 2.0])
def test_lines_stand_as_far_apart_as_asked_for(spacing: float) -> None:
    letters = text_artwork("ab\nab\nab", BOXES, TextStyle(line_spacing=spacing))
    middles = [(low + high) / 2 for low, high in bands(letters, 1)]
    assert np.diff(middles) == pytest.approx([spacing / 1.1] * 2)


def test_lines_never_run_together_however_high_their_letters_are() -> None:
    letters = text_artwork(
        "\u0f56\u0f7c\u0f51\u0f0b\u0f61\u0f72\u0f42\nA\u030a\u0323yj\n\u1e68", style=TextStyle(line_spacing=0.8)
    )
    gaps = [after[0] - before[1] for before, after in zip(bands(letters, 1), bands(letters, 1)[1:], strict=False)]
    assert min(gaps) > 0


def test_letters_stand_further_apart_when_asked_to() -> None:
    letters = text_artwork("abc", BOXES, TextStyle(letter_spacing=0.4))
    columns = bands(letters, 0)
    assert np.diff([low for low, _ in columns]) == pytest.approx([1.0 / 2.5] * 2)


@pytest.mark.parametrize("text", ["\u0645\u0631\u062d\u0628\u0627", "\u0928\u092e\u0938\u094d\u0924\u0947"])
def test_joined_letters_stay_joined(text: str) -> None:
    plain, spaced = set_text(text), set_text(text, TextStyle(letter_spacing=0.5))
    assert spaced.glyphs == plain.glyphs
    two = set_text(f"{text} {text}", TextStyle(letter_spacing=0.5))
    assert max(glyph.x for glyph in two.glyphs) > max(glyph.x for glyph in set_text(f"{text} {text}").glyphs)


def test_marks_and_ligatures_keep_their_place_in_spaced_text() -> None:
    plain, spaced = set_text("q\u0308fi"), set_text("q\u0308fi", TextStyle(letter_spacing=0.5))
    assert spaced.glyphs[1].x == plain.glyphs[1].x
    assert len(spaced.glyphs) == 4  # "fi" is two letters


def test_each_line_runs_from_where_its_own_script_begins() -> None:
    dot = set_text(".").glyphs[0].id
    glyphs = set_text("a.\n\u05d0.").glyphs
    assert [glyph.id == dot for glyph in glyphs] == [False, True, True, False]


def test_ideographs_stand_upright_in_columns_from_right_to_left() -> None:
    letters = text_artwork("\u4e00\u4e00\n\u4e00", style=VERTICAL)
    assert len(bands(letters, 0)) == 2
    right = [ring for ring in letters.rings if ring[:, 0].mean() > 0]
    assert len(right) == 2
    assert all(np.ptp(ring[:, 0]) > np.ptp(ring[:, 1]) for ring in letters.rings)  # the one stroke lies
    assert letters.line_height == pytest.approx(float(np.ptp(right[0][:, 0])), rel=0.01)


@pytest.mark.parametrize(
    ("text", "sideways"),
    [
        ("AI\u751f", [False] * 3),
        ("\u751f2D", [False] * 3),
        ("\u751fabc", [False, True, True, True]),
        ("ABCD", [True] * 4),
    ],
)
def test_words_are_turned_and_short_acronyms_are_not(text: str, sideways: list[bool]) -> None:
    assert [glyph.sideways for glyph in set_text(text, VERTICAL).glyphs] == sideways


def test_a_turned_word_is_the_word_turned_clockwise() -> None:
    row, column = text_artwork("Sample"), text_artwork("Sample", style=VERTICAL)
    assert column.aspect == pytest.approx(1 / row.aspect)
    assert column.ink == pytest.approx(row.ink)
    first = min(row.rings, key=lambda ring: float(ring[:, 0].min()))
    top = max(column.rings, key=lambda ring: float(ring[:, 1].max()))
    np.testing.assert_allclose(np.ptp(top, axis=0), np.ptp(first, axis=0)[::-1] / row.aspect, rtol=0.02)


@pytest.mark.parametrize(
    ("text", "says"),
    [("a\nb\nc\nd\ne\nf\ng", "7 lines"), ("a\u200bb", "U+200B at position 2"), ("a\n\tb", "U+0009 at position 3")],
)
def test_text_that_cannot_be_set_is_refused_in_words(text: str, says: str) -> None:
    with pytest.raises(MeshmarkError) as caught:
        set_text(text)
    assert caught.value.code is ErrorCode.INVALID_PARAMETERS
    assert says in caught.value.message


def test_a_text_of_sixty_letters_is_set() -> None:
    text = "made with love and patience by the studio of Ada Lovelace & co"
    assert len(text) > 60
    assert text_artwork(text).line_height == text_artwork(text).aspect < 0.03


def test_the_fonts_that_serve_are_known_before_and_whatever_is_missing() -> None:
    (latin, han) = serving_fonts("AI\ue000\n\u751f", None)
    assert latin.startswith("DejaVu Sans Bold 2.")
    assert han.startswith("Noto Sans CJK SC Bold ")
    assert serving_fonts("", None) == []


@given(
    st.lists(st.text("aB\u05d0\u0628\u751f\u0915 ", max_size=5), min_size=1, max_size=6).filter(
        lambda t: any(map(str.strip, t))
    )
)
def test_any_lines_make_one_block_of_width_one(lines: list[str]) -> None:
    for style in (TextStyle(), VERTICAL):
        letters = text_artwork("\n".join(lines), style=style)
        points = np.concatenate(letters.rings)
        assert np.ptp(points[:, 0]) == pytest.approx(1)
        assert 0 < letters.line_height <= max(1.0, letters.aspect) * 1.001


def test_the_first_of_several_lines_may_be_larger_and_legibility_goes_by_the_others() -> None:
    style = TextStyle(first_line=1.6)
    plain, large = (text_artwork("AI\nGENERATED", style=one) for one in (PLAIN, style))
    small, high = np.diff(bands(large, 1), axis=1)[:, 0]
    assert high / small == pytest.approx(1.6, rel=0.05)
    assert large.line_height == pytest.approx(plain.line_height)
    one = text_artwork("AI", style=style)
    assert (one.aspect, one.line_height) == (text_artwork("AI").aspect, text_artwork("AI").line_height)
