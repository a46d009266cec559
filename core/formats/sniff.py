"""Recognition of a file's format by its content, never by its name: the signs are in the rows of the formats."""

import re

from core.budgets import DEFAULT_BUDGETS, Budgets
from core.errors import ErrorCode, MeshmarkError
from core.formats.archive import MAGIC, Archive
from core.formats.format import Format
from core.formats.registry import FORMATS
from core.formats.signs import Certainty, head, is_printable

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


def sniff(data: bytes, budgets: Budgets = DEFAULT_BUDGETS) -> Format:
    """The format of a non-empty file.

    Raises:
        MeshmarkError: ``unsupported_format`` for other 3D formats, ``unknown_format`` for anything else; both name the
            apparent format. For an archive also as :class:`core.formats.archive.Archive`.
    """
    start = head(data)
    if start.startswith(MAGIC):
        return _archive_format(Archive(data, budgets))
    for certainty in Certainty:
        for file_format, spec in FORMATS.items():
            if any(sign.certainty is certainty and sign.shows(data) for sign in spec.sniff):
                return file_format
        if certainty is Certainty.SIGNATURE:
            _refuse_other(start)
    raise _unknown("it looks like plain text" if is_printable(start) else "it is binary data of no known kind")


def _refuse_other(start: bytes) -> None:
    """Refuse a file that begins as one of another known kind."""
    for pattern, kind in _OTHER_MODELS:
        if re.match(pattern, start):
            raise _unsupported(kind)
    for pattern, kind in _OTHER_CONTENT:
        if re.match(pattern, start, re.DOTALL):
            raise _unknown(f"it looks like {kind}")


def model_in(archive: Archive, file_format: Format) -> str:
    """The name of the one model of this format (``...+zip``) in an archive.

    Raises:
        MeshmarkError: ``unsupported_feature`` where there are several.
    """
    return archive.only(file_format.ending)


def models_beside(archive: Archive, file_format: Format) -> list[str]:
    """The names of the models of other formats in an archive, which are not read."""
    endings = tuple(each.ending for each in FORMATS if each is not file_format.inner)
    return [name for name in archive.names if name.lower().endswith(endings)]


def _archive_format(archive: Archive) -> Format:
    """Format of the model in a ZIP, by the names in its directory; nothing is unpacked."""
    names = [name.lower() for name in archive.names]
    for file_format, spec in FORMATS.items():
        if spec.part and any(name.endswith(spec.part) for name in names):
            return file_format
    for file_format in FORMATS:
        if any(name.endswith(file_format.ending) for name in names):
            return file_format.archived
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
