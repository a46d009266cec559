"""Text to placed glyphs: normalisation, bidirectional order, script runs, HarfBuzz."""

import unicodedata
from dataclasses import dataclass
from itertools import groupby

import uharfbuzz as hb
from bidi import algorithm as bidi
from fontTools.unicodedata import script as script_of

from core.errors import ErrorCode, MeshmarkError

# Glyphs a character, at most: a letter may be several (marks, parts of a conjunct), but rules can multiply without end.
GLYPHS_PER_CHARACTER = 32

_JOINERS = "\u200c\u200d"  # zero-width (non-)joiners steer the shaping of Arabic and Indic scripts
_REFUSED_CATEGORIES = {"Cc": "control", "Cf": "formatting", "Cs": "surrogate", "Zl": "line break", "Zp": "line break"}
_COMMON_SCRIPTS = ("Zyyy", "Zinh", "Zzzz")  # take the script of the text around them (UAX 24)


@dataclass(frozen=True)
class Glyph:
    """One glyph of the shaped line: its number in the font and its origin, in font units."""

    id: int
    x: int
    y: int


@dataclass(frozen=True)
class _Character:
    """A character as the bidirectional algorithm leaves it: its place in the text, its level and script."""

    index: int
    level: int
    script: str


def shape(text: str, font: hb.Font) -> list[Glyph]:
    """The glyphs of one line of ``text``, from left to right, kerned, with ligatures and combining marks placed.

    Mixed directions are ordered by the Unicode bidirectional algorithm (UAX 9), the base direction taken from the
    first strong character.

    Raises:
        MeshmarkError: ``empty_text`` (nothing visible), ``invalid_parameters`` (control or formatting characters),
            ``missing_glyphs`` (naming each character that the font lacks), ``invalid_font`` (it multiplies glyphs).
    """
    _require_printable(text)
    text = unicodedata.normalize("NFC", text)
    _require_outlines(text, font)
    codepoints = [ord(character) for character in text]
    glyphs: list[Glyph] = []
    missing: set[str] = set()
    pen = 0
    for (level, script), group in groupby(_visual_order(text), key=lambda item: (item.level, item.script)):
        indices = [character.index for character in group]
        start, stop = min(indices), max(indices) + 1  # a run in visual order is contiguous in the text as well
        buffer = hb.Buffer()
        buffer.cluster_level = hb.BufferClusterLevel.CHARACTERS  # so that a missing glyph names its own character
        buffer.add_codepoints(codepoints, start, stop - start)
        buffer.direction = "rtl" if level % 2 else "ltr"
        buffer.script = script
        buffer.language = "und"  # never the machine's locale: the same text must give the same letters anywhere
        try:
            hb.shape(font, buffer)
        except MemoryError:  # HarfBuzz bounds the glyphs that a font makes of a text
            raise _endless_rules() from None
        if len(buffer) > GLYPHS_PER_CHARACTER * (stop - start):
            raise _endless_rules()
        for info, position in zip(buffer.glyph_infos, buffer.glyph_positions, strict=True):
            if info.codepoint == 0:
                missing.add(text[info.cluster])
            glyphs.append(Glyph(info.codepoint, pen + position.x_offset, position.y_offset))
            pen += position.x_advance
    if missing:
        raise _missing_glyphs(missing)
    return glyphs


def _require_printable(text: str) -> None:
    if not text.strip():
        raise MeshmarkError(
            ErrorCode.EMPTY_TEXT, "The watermark text is empty or only spaces.", "Send at least one visible character."
        )
    for position, character in enumerate(text):
        kind = _REFUSED_CATEGORIES.get(unicodedata.category(character))
        if kind and character not in _JOINERS:
            raise MeshmarkError(
                ErrorCode.INVALID_PARAMETERS,
                f"The watermark text has a {kind} character U+{ord(character):04X} at position {position + 1}.",
                "Send one line of visible characters.",
            )


def _require_outlines(text: str, font: hb.Font) -> None:
    """Refuse characters whose glyph exists but is blank, as in colour and bitmap fonts: they would vanish."""
    blank = {
        character
        for character in set(text)
        if unicodedata.category(character)[0] in "LNPS"
        and (glyph := font.get_nominal_glyph(ord(character)))
        and not any(font.get_glyph_extents(glyph) or ())
    }
    if blank:
        raise _missing_glyphs(blank)


def _missing_glyphs(characters: set[str]) -> MeshmarkError:
    listed = ", ".join(f"{character} (U+{ord(character):04X})" for character in sorted(characters))
    return MeshmarkError(
        ErrorCode.MISSING_GLYPHS,
        f"The font has no outline for {listed}.",
        "Leave these characters out or send a font that has them.",
    )


def _endless_rules() -> MeshmarkError:
    return MeshmarkError(
        ErrorCode.INVALID_FONT,
        f"The rules of the font make more than {GLYPHS_PER_CHARACTER} glyphs of a letter of this text.",
        "Send the font as its maker publishes it, or another one.",
    )


def _visual_order(text: str) -> list[_Character]:
    """The characters of ``text`` from left to right as displayed (UAX 9, rules P2 to L2)."""
    scripts = _scripts(text)
    level = bidi.get_base_level(text)
    storage = bidi.get_empty_storage() | {"base_level": level, "base_dir": "LR"[level]}
    bidi.get_embedding_levels(text, storage)
    for index, character in enumerate(storage["chars"]):
        character["index"] = index
    bidi.explicit_embed_and_overrides(storage)
    bidi.resolve_weak_types(storage)
    bidi.resolve_neutral_types(storage, False)
    bidi.resolve_implicit_levels(storage, False)
    bidi.reorder_resolved_levels(storage, False)
    return [_Character(item["index"], item["level"], scripts[item["index"]]) for item in storage["chars"]]


def _scripts(text: str) -> list[str]:
    """The script of each character; common and inherited ones take that of the letter before (or else after)."""
    scripts: list[str] = [script_of(character) for character in text]
    current = next((script for script in scripts if script not in _COMMON_SCRIPTS), "Zyyy")
    for index, script in enumerate(scripts):
        current = scripts[index] = current if script in _COMMON_SCRIPTS else script
    return scripts
