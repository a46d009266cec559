"""STL, binary: the triangles of a marked scene."""

import numpy as np

from core.formats.format import Format, Written
from core.formats.marked import Marked, drawn
from core.formats.stl import HEADER_BYTES, RECORD
from core.geometry.triangles import flat_normals

_HEADER = HEADER_BYTES - 4


def write_stl(marked: Marked) -> Written:
    """All triangles, in 32-bit floats; the label stands in the header.

    An STL has triangles and nothing else: no colours, materials, textures, names or parts.
    """
    drawing, frame = drawn(marked, Format.STL)
    corners = np.concatenate([part.positions[part.faces] for part in drawing.parts]).astype(np.float32)
    records = np.zeros(len(corners), RECORD)
    records["corners"] = corners
    records["normal"] = flat_normals(corners.astype(np.float64))
    looks = {look for part in drawing.parts for look in np.unique(part.look).tolist()}
    lost = {
        "textures": any(drawing.looks[look].image is not None for look in looks),
        "materials and colours": not all(drawing.looks[look].is_neutral for look in looks)
        or any(part.colors is not None for part in drawing.parts),
        "vertex normals": any(part.normals is not None for part in drawing.parts),
        "names and parts": len(drawing.parts) > 1,
    }
    left_out = [*(what for what, there in lost.items() if there), *drawing.left_out]
    data = header(list(marked.label.values())) + np.uint32(len(records)).tobytes() + records.tobytes()
    return Written({"model.stl": data}, frame.unit, frame.up, left_out)


def header(words: list[str]) -> bytes:
    """80 bytes that no reader takes for text or for the colour of the part: they begin with the program's name, and
    have no ``COLOR=``."""
    ascii_words = [word.rpartition("/")[2] for word in words if word.isascii() and "COLOR=" not in word]
    return " ".join(["meshmark", *ascii_words]).encode()[:_HEADER].ljust(_HEADER)
