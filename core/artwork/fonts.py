"""Font files: checks of uploaded ones, and the one that ships with the engine."""

import struct
from pathlib import Path

import uharfbuzz as hb

from core.errors import ErrorCode, MeshmarkError

MAX_FONT_BYTES = 20 * 2**20
DEFAULT_FONT = Path(__file__).parent / "fonts" / "DejaVuSans-Bold.ttf"

_SIGNATURES = (b"\x00\x01\x00\x00", b"OTTO", b"true")
_REFUSED = {
    b"wOFF": ("is a WOFF web font", "Unpack it to TTF or OTF first, for example with `fonttools ttLib.woff2`."),
    b"wOF2": ("is a WOFF2 web font", "Unpack it to TTF or OTF first, for example with `fonttools ttLib.woff2`."),
    b"ttcf": ("is a collection of several fonts", "Send one font of the collection as a TTF or OTF file."),
    b"typ1": ("is a Type 1 font", "Send the font as a TTF or OTF file."),
    b"%!PS": ("is a Type 1 font", "Send the font as a TTF or OTF file."),
}
_REQUIRED = ("cmap", "head", "hhea", "hmtx", "maxp")
_OUTLINES = (("glyf", "loca"), ("CFF ",), ("CFF2",))


def _invalid(problem: str, remedy: str = "Send a TrueType (.ttf) or OpenType (.otf) font file.") -> MeshmarkError:
    return MeshmarkError(ErrorCode.INVALID_FONT, f"The font {problem}.", remedy)


def _tables(data: bytes) -> dict[str, bytes]:
    """The table directory of an sfnt file, every entry checked against the file's length (OpenType spec, "otff")."""
    signature = data[:4]
    if signature in _REFUSED:
        raise _invalid(*_REFUSED[signature])
    if signature not in _SIGNATURES:
        raise _invalid("is not a TrueType or OpenType file")
    if len(data) < 12:
        raise _invalid("is cut off in its header")
    (count,) = struct.unpack_from(">H", data, 4)
    if len(data) < 12 + 16 * count:
        raise _invalid("is cut off in its table directory")
    tables: dict[str, bytes] = {}
    for tag, _, offset, length in struct.iter_unpack(">4sIII", data[12 : 12 + 16 * count]):
        name = tag.decode("latin-1")
        if offset + length > len(data):
            raise _invalid(f"is cut off: its table {name!r} ends at byte {offset + length} of {len(data)}")
        if name in tables:
            raise _invalid(f"lists its table {name!r} twice")
        tables[name] = data[offset : offset + length]
    return tables


def load_font(data: bytes) -> hb.Font:
    """A font ready for shaping, at its own units (scale = units per em), variable fonts at their default instance.

    Only plain sfnt files (TrueType and OpenType/CFF outlines) of at most 20 MB are accepted. Nothing in the file is
    decompressed or parsed as XML.

    Raises:
        MeshmarkError: ``invalid_font``.
    """
    if len(data) > MAX_FONT_BYTES:
        raise _invalid(
            f"has {len(data) / 2**20:.1f} MB; the limit is {MAX_FONT_BYTES // 2**20} MB",
            "Subset the font to the letters of the watermark, for example with `pyftsubset`.",
        )
    if not data:
        raise _invalid("file is empty")
    tables = _tables(data)
    missing = [name for name in _REQUIRED if not tables.get(name)]
    if missing:
        raise _invalid(f"lacks the tables {', '.join(missing)}")
    if not any(all(tables.get(name) for name in names) for names in _OUTLINES):
        raise _invalid(
            "has no outlines, only bitmaps or coloured pictures",
            "Send a font with TrueType or CFF outlines; colour emoji fonts cannot be embossed.",
        )
    head = tables["head"]
    # HarfBuzz would quietly replace a nonsensical size of the em by 1000, so it is checked here.
    upem = struct.unpack_from(">H", head, 18)[0] if len(head) >= 54 else 0
    if not 16 <= upem <= 16384:
        raise _invalid(f"declares {upem} units per em, which the format does not allow (16 to 16384)")
    face = hb.Face(data)
    if face.glyph_count == 0 or not face.unicodes:
        raise _invalid("maps no characters to glyphs")
    return hb.Font(face)
