"""The header of a PLY: its elements and their properties."""

import re
import struct
from dataclasses import dataclass

from core.refusals import malformed, truncated

STRIPS = "tristrips"
BYTE_ORDERS = {"ascii": "<", "binary_little_endian": "<", "binary_big_endian": ">"}

_HEADER_LIMIT = 2**20
_TYPES = {
    **dict.fromkeys(("char", "int8"), "b"),
    **dict.fromkeys(("uchar", "uint8"), "B"),
    **dict.fromkeys(("short", "int16"), "h"),
    **dict.fromkeys(("ushort", "uint16"), "H"),
    **dict.fromkeys(("int", "int32"), "i"),
    **dict.fromkeys(("uint", "uint32"), "I"),
    **dict.fromkeys(("float", "float32"), "f"),
    **dict.fromkeys(("double", "float64"), "d"),
}
# The comment that MeshLab and compatible programs write.
_TEXTURE = re.compile(rb"\s*comment\s+TextureFile\s+(.*\S)", re.IGNORECASE)


@dataclass(frozen=True)
class Property:
    """A column of an element: one number of ``kind``, or a list of them whose length is a ``count_kind``."""

    name: str
    kind: str
    count_kind: str = ""


@dataclass(frozen=True)
class Element:
    """A table of the file: ``count`` rows of properties."""

    name: str
    count: int
    properties: tuple[Property, ...]

    @property
    def least_row_bytes(self) -> int:
        """Bytes of a row whose lists are all empty."""
        return sum(struct.calcsize("<" + (column.count_kind or column.kind)) for column in self.properties)


@dataclass(frozen=True)
class Header:
    """The declarations of a PLY, and the start of its body.

    ASCII numbers are parsed as doubles: ``kind`` still tells their type, since colours are scaled by it. ``textures``
    are names of files, in whatever code page.
    """

    format: str
    elements: tuple[Element, ...]
    end: int
    textures: tuple[bytes, ...] = ()

    def element(self, name: str) -> Element | None:
        """The element of this name, if any."""
        return next((element for element in self.elements if element.name == name), None)

    @property
    def surface(self) -> Element | None:
        """The element that holds the surface: faces, or triangle strips where there are none."""
        named = (self.element(name) for name in ("face", STRIPS))
        return next((element for element in named if element is not None and element.count), None)


def parse_header(data: bytes) -> Header:
    """Read a PLY header; lines that start with a word of no meaning there, as old exporters write them, are skipped.

    Raises:
        MeshmarkError: ``malformed_file``, or ``truncated_file`` where the header never ends.
    """
    marker = data.find(b"end_header", 0, _HEADER_LIMIT)
    end = min((at for at in (data.find(b"\n", marker), data.find(b"\r", marker)) if at >= 0), default=len(data))
    if marker < 0:
        raise truncated("The PLY header never ends.")
    end += 2 if data[end : end + 2] == b"\r\n" else 1
    file_format, elements, textures = "", [], []
    for raw in data[:marker].splitlines()[1:]:
        if (texture := _TEXTURE.fullmatch(raw)) is not None:
            textures.append(texture[1])
        line = raw.decode("ascii", "replace")
        match line.split():
            case ["format", name, _] if name in BYTE_ORDERS:
                file_format = name
            case ["element", name, count] if count.isdecimal() and len(count) < 19:
                elements.append((name, int(count), list[Property]()))
            case ["property", "list", count_kind, kind, name] if elements and {count_kind, kind} <= _TYPES.keys():
                elements[-1][2].append(Property(name, _TYPES[kind], _TYPES[count_kind]))
            case ["property", kind, name] if elements and kind in _TYPES:
                elements[-1][2].append(Property(name, _TYPES[kind]))
            case ["format" | "element" | "property", *_]:
                raise malformed(f"The PLY header has a line that is not understood: {line.strip()[:60]!r}.")
    if not file_format:
        raise malformed("The PLY header does not say whether the file is text or binary.")
    tables = tuple(Element(name, count, tuple(columns)) for name, count, columns in elements)
    return Header(file_format, tables, end, tuple(textures))
