"""Typefaces: opened fonts, with what choosing among them and naming them takes."""

import unicodedata
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path

import uharfbuzz as hb

from core.artwork.fonts import DEFAULT_FONT, load_font

BOLD = 700  # of the weight axis
LONGEST_NAME = 100  # characters of a name that a font gives itself

# Joiners and variation selectors: they steer the choice of glyphs, and need none themselves.
_INVISIBLE = {0x34F, 0x200C, 0x200D, *range(0x180B, 0x180E), *range(0xFE00, 0xFE10), *range(0xE0100, 0xE01F0)}


@dataclass(frozen=True)
class TypefaceOptions:
    """Tuned values of typefaces.

    Attributes:
        offset: how far the outlines of a face of normal weight are moved outwards, in ems; about as much as parts Noto
            Sans Regular from Bold. Thin strokes would be lost in a coarse surface. Ours; the paper has one bold font.
        bold: least weight that counts as bold; ours.
    """

    offset: float = 0.03
    bold: float = 600.0


OPTIONS = TypefaceOptions()


@dataclass(frozen=True, eq=False)
class Typeface:
    """An open font.

    Attributes:
        name: its full name, as it says itself.
        version: its version, as it says itself.
        font: at its own units (scale = units per em).
        offset: how far its outlines are to be moved outwards, in ems.
    """

    name: str
    version: str
    font: hb.Font
    offset: float = 0.0

    @property
    def upem(self) -> int:
        """Its units per em."""
        return int(self.font.face.upem)

    def lacks(self, cluster: str) -> list[str]:
        """The characters of a grapheme cluster, composed (NFC), that it has no outline for."""
        lacking = [character for character in cluster if not self._has(character)]
        if lacking and not any(map(self._lacks_part, cluster)):
            return []  # HarfBuzz composes them
        return lacking

    def _lacks_part(self, character: str) -> bool:
        return not all(map(self._has, unicodedata.normalize("NFD", character)))

    def _has(self, character: str) -> bool:
        if ord(character) in _INVISIBLE:
            return True
        glyph = self.font.get_nominal_glyph(ord(character))
        if glyph is None:
            return False
        # A letter that is blank, as in fonts of colour pictures and bitmaps, would vanish.
        return unicodedata.category(character)[0] in "ZM" or any(self.font.get_glyph_extents(glyph) or ())


def uploaded_face(data: bytes) -> Typeface:
    """The typeface of a font that came with a request, in bold where it is variable in weight.

    Raises:
        MeshmarkError: ``invalid_font``.
    """
    return _named(load_font(data))


@lru_cache(maxsize=1)
def default_face() -> Typeface:
    """The bundled DejaVu Sans Bold: a bold face keeps its strokes wide enough to be cut into a coarse surface."""
    return uploaded_face(DEFAULT_FONT.read_bytes())


@cache
def installed_faces(path: Path) -> tuple[Typeface, ...]:
    """The typefaces of a font file of this machine, those of a collection in its order; none if it cannot be read.

    The file is mapped, not read, so that a text of few letters costs few pages of a large font.
    """
    try:
        blob = hb.Blob.from_file_path(path)
    except (hb.HarfBuzzError, OSError):
        return ()
    faces = (_named(hb.Font(hb.Face(blob, index))) for index in range(max(1, hb.Face(blob).count)))
    return tuple(
        Typeface(face.name, face.version, face.font, _offset(face.font))
        for face in faces
        if face.font.face.glyph_count and face.font.face.unicodes
    )


def _named(font: hb.Font) -> Typeface:
    for axis in font.face.axis_infos:
        if axis.tag == "wght":
            font.set_variations({"wght": min(max(BOLD, axis.min_value), axis.max_value)})
    names = hb.OTNameIdPredefined
    name = _printable(font.face.get_name(names.FULL_NAME) or font.face.get_name(names.FONT_FAMILY))
    version = _printable(font.face.get_name(names.VERSION_STRING)).removeprefix("Version ").partition(";")[0]
    return Typeface(name or "unnamed", version, font)


def _offset(font: hb.Font) -> float:
    return 0.0 if font.get_style_value(hb.StyleTag.WEIGHT) >= OPTIONS.bold else OPTIONS.offset


def _printable(text: str | None) -> str:
    return "".join(character for character in text or "" if character.isprintable())[:LONGEST_NAME].strip()
