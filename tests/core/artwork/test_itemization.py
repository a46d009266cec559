import os
import subprocess
import sys
import unicodedata

import pytest
from bidi import get_display
from hypothesis import given
from hypothesis import strategies as st

from core.artwork.bidi import visual_order
from core.artwork.itemization import FontChain, clusters_of, language_of, text_of
from core.artwork.layout import set_text
from core.artwork.outline import text_artwork
from core.artwork.style import TextStyle
from core.artwork.typeface import uploaded_face
from core.errors import ErrorCode, MeshmarkError
from tests.core.artwork.fontsmith import SQUARE, make_font

MIXED = st.text(
    alphabet="ab 12.,-()[]:+/\u05d0\u05d1\u0628\u0645\u0661\u0301\u0915\u093f\u0e01\u751f\u3001\uac00\u200d",
    max_size=14,
).filter(lambda text: bool(text.strip(" \u200d")))


def fonts(text: str, language: str | None = None) -> list[str]:
    return [face.name for face in set_text(text, TextStyle(language=language)).faces]


def refusal(text: str) -> MeshmarkError:
    with pytest.raises(MeshmarkError) as caught:
        set_text(text)
    return caught.value


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("watermark", ["DejaVu Sans Bold"]),
        ("\u0412\u043e\u0434\u044f\u043d\u043e\u0439 \u03c9", ["DejaVu Sans Bold"]),
        ("AI \u751f\u6210", ["DejaVu Sans Bold", "Noto Sans CJK SC Bold"]),
        ("\u751f\u6210AI 2026\u3002", ["Noto Sans CJK SC Bold"]),  # the last font stays while it has the letters
        ("\u0645\u0631\u062d\u0628\u0627", ["Noto Sans Arabic Bold"]),
        ("\u0928\u092e\u0938\u094d\u0924\u0947", ["Noto Sans Devanagari Bold"]),
        ("\u0f56\u0f7c\u0f51", ["Noto Serif Tibetan Bold"]),  # there is no sans
        ("\u07d2\u07de\u07cf", ["Noto Sans NKo Regular"]),
    ],
)
def test_each_script_has_its_font_and_the_bundled_one_serves_latin_greek_and_cyrillic(
    text: str, expected: list[str]
) -> None:
    assert fonts(text) == expected


@pytest.mark.parametrize(
    ("text", "language", "region"),
    [
        ("\u76f4", None, "SC"),
        ("\u76f4\u306e", None, "JP"),
        ("\u76f4\uc9c1", None, "KR"),
        ("\u76f4\u3105", None, "TC"),
        ("\u76f4", "ja", "JP"),
        ("\u76f4", "ko", "KR"),
        ("\u76f4", "zh-Hant", "TC"),
        ("\u76f4", "zh-TW", "TC"),
        ("\u76f4", "zh-HK", "HK"),
        ("\u76f4", "fr", "SC"),
    ],
)
def test_ideographs_have_the_shapes_of_their_language(text: str, language: str | None, region: str) -> None:
    assert fonts(text, language) == [f"Noto Sans CJK {region} Bold"]
    assert (
        language_of(text, language)
        in {"SC": ["zh-Hans"], "TC": ["zh-Hant"], "HK": ["zh-HK"], "JP": ["ja"], "KR": ["ko"]}[region]
    )


def test_the_shapes_of_one_ideograph_differ_by_language() -> None:
    outlines = {
        language: text_artwork("\u9aa8", style=TextStyle(language=language)).ink
        for language in ("zh-Hans", "zh-Hant", "ja")
    }
    assert len(set(outlines.values())) == 3


def test_a_face_without_bold_is_thickened_and_says_by_how_much() -> None:
    (thin,) = text_artwork("\u07d2\u07de\u07cf").faces
    (bold,) = text_artwork("\u0928\u092e").faces
    assert (thin.offset, bold.offset) == (0.03, 0.0)


def test_a_letter_and_its_marks_come_from_one_font() -> None:
    own = uploaded_face(make_font({"x": [SQUARE], "q": [SQUARE]}))
    assert [face.name for face in set_text("xq\u0308", own=own).faces] == ["Test", "DejaVu Sans Bold"]


def test_the_font_that_was_sent_serves_wherever_it_can() -> None:
    own = uploaded_face(make_font({"A": [SQUARE], "I": [SQUARE]}))
    block = set_text("AI\u751fAI", own=own)
    assert [glyph.face is own for glyph in block.glyphs] == [True, True, False, True, True]


@pytest.mark.parametrize("character", ["\ue000", "\U0001f984", "\u0378"])
def test_what_no_font_has_is_refused_by_its_code_point(character: str) -> None:
    error = refusal(f"ab\nc{character}")
    assert error.code is ErrorCode.MISSING_GLYPHS
    assert f"U+{ord(character):04X}" in error.message
    assert "send a font that has them" in error.remedy


def test_a_package_that_may_have_the_missing_letter_is_named() -> None:
    assert "Debian package fonts-symbola" in refusal("\U0001f984").remedy


def test_a_shared_full_stop_is_of_the_script_that_the_text_has() -> None:
    assert {cluster.script for cluster in clusters_of("\u751f\u6210\u3002")} == {"Hani"}
    assert [cluster.script for cluster in clusters_of("(\u05d0) a")] == ["Hebr"] * 4 + ["Latn"]


def test_brackets_that_belong_together_have_one_direction() -> None:
    text = "a (\u05d0) \u05d1"  # the closing one, too, is of the Latin line
    assert "".join(text[index] for index, _ in visual_order(text)) == "a (\u05d0) \u05d1"


@given(MIXED)
def test_mixed_directions_are_ordered_as_by_another_implementation(text: str) -> None:
    ours = [text[index] for index, _ in visual_order(text)]
    mirrored = {"(": ")", ")": "(", "[": "]", "]": "["}
    theirs = [character for character in get_display(text) if character != "\u200d"]
    seen = [mirrored.get(c, c) if level % 2 else c for c, (_, level) in zip(ours, visual_order(text), strict=True)]
    assert seen == theirs or ours == theirs


@given(MIXED)
def test_every_letter_of_a_mixed_text_is_set_once_and_in_one_piece(text: str) -> None:
    composed = unicodedata.normalize("NFC", text)
    clusters = clusters_of(composed)
    (pieces,) = FontChain(language_of(text, None)).choose([clusters])
    assert text_of(pieces) == composed
    assert not any(face.lacks(cluster.text) for cluster, face in pieces)
    block = set_text(text)
    assert all(glyph.id for glyph in block.glyphs)
    assert set_text(text).glyphs == block.glyphs


def test_fonts_and_letters_are_the_same_in_every_process() -> None:
    text = "AI \u751f\u6210\u3002 \u2605 \u0645\u0631 \u30fc (\u05d0)"
    script = (
        "import hashlib; from core.artwork.outline import text_artwork;"
        f"letters = text_artwork({text!r}); print(letters.faces);"
        "print(hashlib.sha256(b''.join(ring.tobytes() for ring in letters.rings)).hexdigest())"
    )
    said = {
        subprocess.run(
            [sys.executable, "-c", script],
            env=os.environ | {"PYTHONHASHSEED": seed, "LANG": lang},
            check=True,
            capture_output=True,
        ).stdout
        for seed, lang in (("1", "C"), ("2", "ja_JP.UTF-8"))
    }
    assert len(said) == 1
