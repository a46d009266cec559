"""Runs of text to placed glyphs, by HarfBuzz."""

import unicodedata
from collections.abc import Iterable
from dataclasses import dataclass

import uharfbuzz as hb
from uniseg.graphemecluster import grapheme_clusters

from core.artwork.installed import CJK
from core.artwork.itemization import JOINED, Run
from core.artwork.typeface import Typeface
from core.errors import ErrorCode, MeshmarkError

# Glyphs a character, at most: a letter may be several (marks, parts of a conjunct), but rules can multiply without end.
GLYPHS_PER_CHARACTER = 32

VIRAMA = 9  # the combining class of what makes the letter after it part of the same conjunct


@dataclass(frozen=True)
class Glyph:
    """One glyph of a text that is set.

    Attributes:
        face: its typeface.
        id: its number there.
        x, y: of its origin.
        sideways: turned a quarter clockwise about its origin.
        scale: of its outline.
    """

    face: Typeface
    id: int
    x: float
    y: float
    sideways: bool = False
    scale: float = 1.0


@dataclass(frozen=True)
class Spacing:
    """Setting of the letters in a line.

    Attributes:
        upem: units an em of all lengths.
        letters: added between them, in ems.
        language: BCP 47 tag, or "und".
        han: BCP 47 tag of the language whose ideographs are drawn.
        vertical: set from the top down, each letter upright.
    """

    upem: int
    letters: float = 0.0
    language: str = "und"  # never the machine's locale: the same text must give the same letters anywhere
    han: str = "zh-Hans"
    vertical: bool = False


def shape(text: str, runs: Iterable[Run], spacing: Spacing) -> tuple[list[Glyph], float]:
    """The glyphs of a line's runs in their order, kerned, with ligatures and combining marks placed; and its advance.

    The line begins at the origin and goes to the right or, set vertically, down.

    Raises:
        MeshmarkError: ``missing_glyphs`` (naming each character that its font cannot draw), ``invalid_font`` (it
            multiplies glyphs).
    """
    glyphs: list[Glyph] = []
    missing: set[str] = set()
    pen = 0.0
    gap = 0.0  # owed between the letter before and the next one
    for run in runs:
        buffer = _shaped(text, run, spacing)
        breaks = _letter_starts(text, run) if spacing.letters else set()
        scale = spacing.upem / run.face.upem
        before = None
        for info, position in zip(buffer.glyph_infos, buffer.glyph_positions, strict=True):
            if info.codepoint == 0:
                missing.add(text[info.cluster])
            if info.cluster != before and (before is None or max(info.cluster, before) in breaks):
                pen += gap
            before = info.cluster
            gap = spacing.letters * spacing.upem
            x, y = position.x_offset * scale, position.y_offset * scale
            if spacing.vertical:
                glyphs.append(Glyph(run.face, info.codepoint, x, y - pen))
                pen -= position.y_advance * scale
            else:
                glyphs.append(Glyph(run.face, info.codepoint, pen + x, y))
                pen += position.x_advance * scale
    if missing:
        raise _unshaped(missing)
    return glyphs, pen


def _shaped(text: str, run: Run, spacing: Spacing) -> hb.Buffer:
    buffer = hb.Buffer()
    buffer.cluster_level = hb.BufferClusterLevel.CHARACTERS  # so that a missing glyph names its own character
    buffer.add_codepoints([ord(character) for character in text], run.start, run.stop - run.start)
    across = "rtl" if run.level % 2 else "ltr"
    buffer.direction = "ttb" if spacing.vertical else across
    buffer.script = run.script
    buffer.language = spacing.han if run.script in CJK else spacing.language
    try:
        hb.shape(run.face.font, buffer, {"liga": False, "clig": False} if spacing.letters else None)
    except MemoryError:  # HarfBuzz bounds the glyphs that a font makes of a text
        raise _endless_rules() from None
    if len(buffer) > GLYPHS_PER_CHARACTER * (run.stop - run.start):
        raise _endless_rules()
    return buffer


def _letter_starts(text: str, run: Run) -> set[int]:
    """The places in a run before which letter spacing may stand."""
    starts = set()
    place = 0
    piece = text[run.start : run.stop]
    for cluster in grapheme_clusters(piece):
        beside = piece[max(place - 1, 0)], cluster[0]
        joined = run.script in JOINED and not any(character.isspace() for character in beside)
        if place and not joined and unicodedata.combining(beside[0]) != VIRAMA:
            starts.add(run.start + place)
        place += len(cluster)
    return starts


def _unshaped(characters: set[str]) -> MeshmarkError:
    listed = ", ".join(f"{character} (U+{ord(character):04X})" for character in sorted(characters))
    return MeshmarkError(
        ErrorCode.MISSING_GLYPHS,
        f"The font cannot draw {listed} as it stands in this text.",
        "Leave these characters out or send a font that has them.",
    )


def _endless_rules() -> MeshmarkError:
    return MeshmarkError(
        ErrorCode.INVALID_FONT,
        f"The rules of the font make more than {GLYPHS_PER_CHARACTER} glyphs of a letter of this text.",
        "Send the font as its maker publishes it, or another one.",
    )
