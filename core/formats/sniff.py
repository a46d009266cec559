"""Formats of files, recognised by content alone, never by name."""

import re
from enum import StrEnum

from core.budgets import DEFAULT_BUDGETS, Budgets
from core.errors import ErrorCode, MeshmarkError
from core.formats import stl
from core.formats.archive import MAGIC, Archive


class Format(StrEnum):
    """The formats that are read."""

    GLB = "glb"
    GLTF = "gltf"
    OBJ = "obj"
    STL = "stl"
    PLY = "ply"
    OFF = "off"
    THREEMF = "3mf"
    DAE = "dae"
    GLTF_ZIP = "gltf+zip"
    OBJ_ZIP = "obj+zip"
    DAE_ZIP = "dae+zip"
    GLB_ZIP = "glb+zip"
    PLY_ZIP = "ply+zip"
    THREEMF_ZIP = "3mf+zip"
    OFF_ZIP = "off+zip"
    STL_ZIP = "stl+zip"

    @property
    def inner(self) -> "Format":
        """The format of the model itself, out of its archive."""
        return Format(self.removesuffix("+zip"))


# The first kind of which an archive holds a model is read: those that bring textures along before those that do not.
_IN_ARCHIVE = tuple(each for each in Format if each.inner is not each)


_HEAD = 4096
_SEARCHED = 2**20  # bytes within which the first vertex or face of an OBJ is searched

# (pattern at the start, name of the format); 3D formats that are recognised but not read
_OTHER_MODELS = (
    (rb"Kaydara FBX Binary|\s*; FBX ", "an FBX scene"),
    (rb"PXR-USDC|#usda", "a USD scene"),
    (rb"BLENDER", "a Blender file"),
    (rb"DRACO", "a bare Draco mesh"),
    (rb"ISO-10303-21", "a STEP model"),
    (rb"#VRML|#X3D", "a VRML scene"),
    (rb"b3dm", "a tile of 3D Tiles (b3dm), a GLB with a header of its own"),
    (rb"i3dm", "a tile of 3D Tiles (i3dm: instances of a model)"),
    (rb"pnts", "a tile of 3D Tiles (pnts: a point cloud)"),
    (rb"cmpt", "a tile of 3D Tiles (cmpt: several tiles in one)"),
    (rb"(?s)\xff\xfe\xff.S\0k\0e\0t\0c\0h\0", "a SketchUp model"),
    (rb"3D Geometry File Format", "a Rhino model"),
)
_OTHER_ENDINGS = {
    ".fbx": "an FBX scene",
    ".blend": "a Blender file",
    ".stp": "a STEP model",
    ".step": "a STEP model",
    ".wrl": "a VRML scene",
    ".skp": "a SketchUp model",
    ".3dm": "a Rhino model",
    ".3ds": "a 3D Studio scene",
    ".max": "a 3ds Max scene",
    ".c4d": "a Cinema 4D scene",
    ".ma": "a Maya scene",
    ".mb": "a Maya scene",
}
_OTHER_CONTENT = (
    (rb"\x89PNG\r\n", "a PNG image"),
    (rb"\xff\xd8\xff", "a JPEG image"),
    (rb"GIF8", "a GIF image"),
    (rb"RIFF....WEBP", "a WebP image"),
    (rb"%PDF", "a PDF document"),
    (rb"\x1f\x8b", "a gzip archive"),
    (rb"7z\xbc\xaf\x27\x1c", "a 7-Zip archive"),
    (rb"Rar!", "a RAR archive"),
    (rb"(?s).{257}ustar", "a tar archive"),
    (rb"\xff\xfe|\xfe\xff", "UTF-16 text"),
    (rb"(?i)\s*(?:<!doctype html|<html)", "an HTML page"),
    (rb"\s*<\?xml", "an XML document"),
    (rb"\s*[{\[]", "JSON"),
)
_DAE = re.compile(rb"(?s)\s*(?:<\?xml.{0,2000}?)?<(?:\w+:)?COLLADA\b")
_GLTF = re.compile(rb'(?s)\s*\{.{0,3900}?"(?:asset|scenes|nodes|meshes|accessors|buffers|bufferViews)"\s*:')
_OBJ_LINE = re.compile(rb"(?:^|[\r\n])[ \t]*(?:v[ \t]+[-+.\d]|f[ \t]+-?\d)")


def sniff(data: bytes, budgets: Budgets = DEFAULT_BUDGETS) -> Format:
    """The format of a non-empty file.

    Raises:
        MeshmarkError: ``unsupported_format`` for other 3D formats, ``unknown_format`` for anything else; both name the
            apparent format. For an archive also as :class:`core.formats.archive.Archive`.
    """
    head = data[:_HEAD].removeprefix(b"\xef\xbb\xbf")
    if head.startswith(b"glTF"):
        return Format.GLB
    if re.match(rb"ply[ \t]*[\r\n]", head):
        return Format.PLY
    if re.match(rb"(?:\s|#[^\n]*\n)*(?:ST)?C?N?4?n?OFF\b", head):
        return Format.OFF
    if head.startswith(MAGIC):
        return _archive_format(Archive(data, budgets))
    if _DAE.match(head):
        return Format.DAE
    if _GLTF.match(head):
        return Format.GLTF
    for pattern, kind in _OTHER_MODELS:
        if re.match(pattern, head):
            raise _unsupported(kind)
    for pattern, kind in _OTHER_CONTENT:
        if re.match(pattern, head, re.DOTALL):
            raise _unknown(f"it looks like {kind}")
    is_text = _is_printable(head)
    if stl.is_ascii(data) and re.search(rb"(?i)facet|endsolid", head):
        return Format.STL
    if _OBJ_LINE.search(data, 0, _SEARCHED if is_text else _HEAD):
        return Format.OBJ
    if _is_binary_stl(data):
        return Format.STL
    raise _unknown("it looks like plain text" if is_text else "it is binary data of no known kind")


def _is_binary_stl(data: bytes) -> bool:
    """Binary STL has no signature: either the size fits the count exactly, or 80 bytes of padded text precede it."""
    if len(data) < stl.HEADER_BYTES:
        return False
    if len(data) == stl.HEADER_BYTES + stl.TRIANGLE_BYTES * stl.claimed_count(data):
        return True
    return _is_printable(data[:80].replace(b"\0", b" ")) and not _is_printable(data[:_HEAD])


def _is_printable(data: bytes) -> bool:
    return re.search(rb"[\x00-\x08\x0e-\x1f\x7f]", data) is None


def model_in(archive: Archive, file_format: Format) -> str:
    """The name of the one model of this format (``...+zip``) in an archive.

    Raises:
        MeshmarkError: ``unsupported_feature`` where there are several.
    """
    return archive.only(f".{file_format.inner}")


def models_beside(archive: Archive, file_format: Format) -> list[str]:
    """The names of the models of other formats in an archive, which are not read."""
    endings = tuple(f".{each.inner}" for each in _IN_ARCHIVE if each is not file_format)
    return [name for name in archive.names if name.lower().endswith(endings)]


def _archive_format(archive: Archive) -> Format:
    """Format of the model in a ZIP, by the names in its directory; nothing is unpacked."""
    names = [name.lower() for name in archive.names]
    if any(name.endswith(".model") for name in names):
        return Format.THREEMF
    for file_format in _IN_ARCHIVE:
        if any(name.endswith(f".{file_format.inner}") for name in names):
            return file_format
    if any(name.endswith((".usdc", ".usda", ".usd")) for name in names):
        raise _unsupported("a USDZ package")
    for ending, kind in _OTHER_ENDINGS.items():
        if found := next((name for name in archive.names if name.lower().endswith(ending)), None):
            raise _unsupported(f"a ZIP archive with {kind}, {found[:60]!r}")
    raise _unsupported("a ZIP archive without a model that is read")


def _unsupported(kind: str) -> MeshmarkError:
    return MeshmarkError(
        ErrorCode.UNSUPPORTED_FORMAT,
        f"The file is {kind}, which this release does not read.",
        "Convert it to a GLB and send that.",
    )


def _unknown(what: str) -> MeshmarkError:
    return MeshmarkError(
        ErrorCode.UNKNOWN_FORMAT,
        f"The content of the file is not a 3D model that is read: {what}.",
        "Send the 3D model itself, best as a GLB.",
    )
